"""Results of many paths: moments and quantiles of functionals, computed chunk by chunk,
and a store on disk.
"""
