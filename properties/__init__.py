"""The laws, one theorem a file: each has a `law`, and a test that any runner can call with a scheme."""
