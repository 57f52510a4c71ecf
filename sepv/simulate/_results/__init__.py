"""Results of many paths: reduced chunk by chunk, kept on disk, or labelled. Plain arrays in, plain records out."""
