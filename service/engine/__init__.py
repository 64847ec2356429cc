"""The method at answering time: pure functions on arrays, without disk, network or clock."""
