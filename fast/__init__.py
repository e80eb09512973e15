"""The fast engine: code that exists only for speed.

Without this folder all results are the same up to rounding.

    engine        the table of fast layers, and other parts of this engine
    slices        the steps of a net: sequences of layers slice by slice, other layers on the whole
                  batch; plan selects them by what the layer types state of themselves; division
                  makes the slices; last_pass computes what they do not store
    tiles         blobs stored in the order in which matrix products write and pooling layers read
    per_channel, convolution, pooling, relu, inner_product, augment, kinematics
                  the fast layers: each is a subclass of the plain layer of the same name with
                  another computation
    columns, rows, row_winograd, winograd, depthwise
                  algorithms for convolutions, of which convolution.py chooses; geometry has
                  what they share
    map_pooling   pooling over any windows
    last_axis     maps with their number as last axis, for depthwise convolutions and max poolings
    row_tiles, window_tiles, max_tiles
                  algorithms on tiles: two for convolutions, one for max poolings
    joint_steps, few_poses
                  what kinematics computes together; the algorithm for a few poses
    fusing        layers in place behind a convolution, computed with it
    parallel, blas
                  threads and working memory; configuration of OpenBLAS before NumPy is loaded

netlib imports this folder by name in one place (netlib/engine.py); nothing else imports it.
"""
