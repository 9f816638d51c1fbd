"""The winding number field of oriented points: sums over all pairs, in n log n."""
