"""HTTP: JSON over REST, with errors as RFC 9457 says."""
