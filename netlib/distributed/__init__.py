"""Data-parallel training with several processes over MPI: sharding, averaged
gradients, agreement.
"""
