"""zenoh: clouds asked about by queries, and streams of clouds answered as robots publish them."""
