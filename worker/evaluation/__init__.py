"""How good concepts are, by labels that serve for nothing else: they judge what was learnt and teach nothing."""
