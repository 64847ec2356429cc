"""One client a wire, each a file that runs by itself."""
