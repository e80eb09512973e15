"""Small nets and weights for the scripts, written to the working directory."""

import caffe
import numpy as np

DEPLOY = """
name: "Small"
input: "data"
input_dim: 2 input_dim: 3 input_dim: 12 input_dim: 12
layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1"
        convolution_param { num_output: 4 kernel_size: 3 stride: 2 pad: 1 weight_filler { type: "xavier" }
                            bias_filler { type: "constant" value: 0.1 } } }
layer { name: "bn1" type: "BatchNorm" bottom: "conv1" top: "conv1" }
layer { name: "scale1" type: "Scale" bottom: "conv1" top: "conv1" scale_param { bias_term: true } }
layer { name: "relu1" type: "ReLU" bottom: "conv1" top: "conv1" }
layer { name: "pool1" type: "Pooling" bottom: "conv1" top: "pool1" pooling_param { pool: MAX kernel_size: 2 stride: 2 } }
layer { name: "fc2" type: "InnerProduct" bottom: "pool1" top: "fc2"
        inner_product_param { num_output: 5 weight_filler { type: "xavier" } } }
layer { name: "prob" type: "Softmax" bottom: "fc2" top: "prob" }
"""


def write(seed=1):
    """Write deploy.prototxt and small.caffemodel, with statistics of BatchNorm that are not zero."""
    with open("deploy.prototxt", "w") as file:
        file.write(DEPLOY)
    caffe.set_random_seed(seed)
    net = caffe.Net("deploy.prototxt", caffe.TEST)
    rng = np.random.default_rng(seed)
    mean, variance, factor = net.params["bn1"]
    mean.data[...], variance.data[...], factor.data[...] = rng.normal(size=4), rng.uniform(1, 2, 4), 2
    net.save("small.caffemodel")


if __name__ == "__main__":
    write()
