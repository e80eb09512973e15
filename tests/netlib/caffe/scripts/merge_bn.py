"""BatchNorm and Scale are merged into the convolutions of a second net, which has none, and its weights are saved.

The scripts that do this for MobileNet-SSD copy only what ``type(...) is caffe._caffe.BlobVec`` accepts.
"""

import caffe
import numpy as np

CONV = """
layer { name: "%s" type: "Convolution" bottom: "%s" top: "%s"
        convolution_param { num_output: 6 kernel_size: 3 bias_term: %s %s weight_filler { type: "msra" } } }
"""
NORM = """
layer { name: "%s/bn" type: "BatchNorm" bottom: "%s" top: "%s" }
layer { name: "%s/scale" type: "Scale" bottom: "%s" top: "%s" scale_param { bias_term: true } }
"""


def text(merged):
    found = 'input: "data" input_shape { dim: 2 dim: 3 dim: 12 dim: 12 }'
    for name, bottom, group in (("conv0", "data", ""), ("conv1/dw", "conv0", "group: 6"), ("conv1", "conv1/dw", "")):
        found += CONV % (name, bottom, name, "true" if merged else "false", group)
        found += "" if merged else NORM % ((name,) * 6)
        found += 'layer { name: "%s/relu" type: "ReLU" bottom: "%s" top: "%s" }' % (name, name, name)
    return found + (CONV % ("mbox_loc", "conv1", "mbox_loc", "true", ""))


def merge_bn(net, nob):
    for key in list(net.params.keys()):
        if type(net.params[key]) is caffe._caffe.BlobVec:
            if key.endswith("/bn") or key.endswith("/scale"):
                continue
            conv = net.params[key]
            if key + "/bn" not in net.params:
                for i, w in enumerate(conv):
                    nob.params[key][i].data[...] = w.data
                continue
            mean, var, factor = (blob.data for blob in net.params[key + "/bn"])
            scale, shift = (blob.data for blob in net.params[key + "/scale"])
            gain = scale / np.sqrt(var / factor + 1e-5)
            nob.params[key][0].data[...] = conv[0].data * gain.reshape(-1, 1, 1, 1)
            nob.params[key][1].data[...] = shift - mean / factor * gain


open("bn.prototxt", "w").write(text(False))
open("nobn.prototxt", "w").write(text(True))
net = caffe.Net("bn.prototxt", caffe.TEST)
rng = np.random.RandomState(0)
for key in net.params:
    if key.endswith("/bn"):
        mean, var, factor = net.params[key]
        mean.data[...], var.data[...], factor.data[...] = rng.randn(6), 1 + rng.rand(6), 2
    if key.endswith("/scale"):
        net.params[key][0].data[...], net.params[key][1].data[...] = 1 + rng.rand(6), rng.randn(6)
net.save("bn.caffemodel")

net = caffe.Net("bn.prototxt", "bn.caffemodel", caffe.TEST)
nob = caffe.Net("nobn.prototxt", caffe.TEST)
merge_bn(net, nob)
nob.save("nobn.caffemodel")
image = rng.rand(2, 3, 12, 12).astype(np.float32)
expected = net.forward(data=image)["mbox_loc"]
found = caffe.Net("nobn.prototxt", "nobn.caffemodel", caffe.TEST).forward(data=image)["mbox_loc"]
assert expected.std() > 0.1 and np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()
print("merged", len(nob.params))
