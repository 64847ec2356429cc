"""Pictures of answers as files: what is drawn of a cloud and its answer, and one writer a format."""
