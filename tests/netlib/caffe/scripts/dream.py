"""DeepDream: gradient ascent on the image, through a layer in the middle, with a patched model and a Classifier."""

import caffe
import numpy as np
from google.protobuf import text_format

model = caffe.io.caffe_pb2.NetParameter()
text_format.Merge(open("deploy.prototxt").read(), model)
model.force_backward = True
open("tmp.prototxt", "w").write(str(model))
net = caffe.Classifier(
    "tmp.prototxt", "small.caffemodel", mean=np.float32([104.0, 116.0, 122.0]), channel_swap=(2, 1, 0)
)


def preprocess(net, img):
    return np.float32(np.rollaxis(img, 2)[::-1]) - net.transformer.mean["data"]


def deprocess(net, img):
    return np.dstack((img + net.transformer.mean["data"])[::-1])


def objective_L2(dst):
    dst.diff[:] = dst.data


def make_step(net, step_size=1.5, end="pool1", jitter=2, clip=True, objective=objective_L2):
    src = net.blobs["data"]
    dst = net.blobs[end]
    ox, oy = np.random.randint(-jitter, jitter + 1, 2)
    src.data[0] = np.roll(np.roll(src.data[0], ox, -1), oy, -2)
    net.forward(end=end)
    objective(dst)
    net.backward(start=end)
    g = src.diff[0]
    src.data[:] += step_size / np.abs(g).mean() * g
    src.data[0] = np.roll(np.roll(src.data[0], -ox, -1), -oy, -2)
    if clip:
        bias = net.transformer.mean["data"]
        src.data[:] = np.clip(src.data, -bias, 255 - bias)


np.random.seed(0)
img = np.random.uniform(0, 255, (16, 16, 3)).astype(np.float32)
src = net.blobs["data"]
src.reshape(1, 3, 16, 16)
src.data[0] = preprocess(net, img)
norms = []
for i in range(8):
    make_step(net, end="pool1")
    norms.append(float(np.square(net.blobs["pool1"].data).sum()))
vis = deprocess(net, src.data[0])
assert vis.shape == (16, 16, 3) and vis.min() >= 0 and vis.max() <= 255.001
assert norms[-1] > 1.05 * norms[0], norms
print("dream", vis.shape)
