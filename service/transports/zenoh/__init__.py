"""zenoh: clouds asked about by queries, and streams of clouds answered as robots publish them.

zenoh calls back on its own threads, and directly (`indirect=False`): otherwise it keeps a queue without bound. What it
calls only puts things in their place.
"""
