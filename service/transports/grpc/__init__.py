"""gRPC: the same use cases as protobuf messages, one by one, in batches and as live streams."""
