"""Everything that exists for speed only. Without this folder all results are the same to rounding, and slower.

    engine        the table of fast layers, and other parts of this engine
    executor      runs a net: rows of layers slice by slice (slices, slice_blobs), others whole; plan decides which, and
                  traits has the properties of each layer type
    tiles         blobs stored in the order in which products write and poolings read
    convolution, pooling, relu, inner_product, hdf5_data, augment, kinematics (and the hand model)
                  the fast layers: each inherits from the plain layer of the same name and replaces its computation
    row_tiles, window_tiles, max_tiles
                  algorithms for convolution and pooling on tiles
    parallel, blas
                  threads, and configuration of OpenBLAS before NumPy is loaded

netlib imports this folder by name in one place (netlib/engine/choice.py); nothing else imports it.
"""
