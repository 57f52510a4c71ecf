"""The laws, one theorem a file: each file has a `law`, and a test that any runner can call with a scheme."""
