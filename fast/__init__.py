"""Everything that exists for speed alone. Delete this folder and every result is the same, slower.

    engine        the table of twins, and what else this engine does its own way
    executor      runs a net: rows of layers slice by slice (slices, slice_blobs), others whole; plan decides which, and
                  facts says what may be known about each layer type
    tiles         blobs stored in the order in which products write and poolings read
    convolution, pooling, relu, inner_product, hdf5_data, augment, hand_model, kinematics, updates
                  the twins: each the plain layer of the same name with its computation replaced
    row_tiles, window_tiles, max_tiles
                  the ways of computing a convolution and a pooling on tiles
    parallel, blas
                  threads, and OpenBLAS set up before NumPy is loaded

netlib asks for this folder by name in one place (netlib/engine/choice.py); nothing else imports it.
"""
