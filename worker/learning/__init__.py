"""The method at training time: clouds become a shape model."""
