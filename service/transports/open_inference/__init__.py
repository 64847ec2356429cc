"""The Open Inference Protocol v2, over HTTP and gRPC: clients of KServe and Triton ask as they ask any model."""
