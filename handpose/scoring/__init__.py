"""How good predicted joints are: errors in mm, success rates, published benchmarks."""
