"""Training with several processes: which rows each reads, means of gradients, agreement, over MPI."""
