"""One cell in a child process."""
