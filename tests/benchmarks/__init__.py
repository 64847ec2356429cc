"""Speeds as ratios against named peers, measured in one run: `./run bench`."""
