"""What is stored, its formats, and how training data is made from it."""
