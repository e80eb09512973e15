"""The habits of classify.py: a Classifier on images, and a Transformer by hand."""

import os

import caffe
import numpy as np

caffe.set_mode_cpu()
mean = np.full((3, 14, 14), 0.3)
np.save("mean.npy", mean)
classifier = caffe.Classifier(
    "deploy.prototxt",
    "small.caffemodel",
    image_dims=(14, 14),
    mean=np.load("mean.npy").mean(1).mean(1),
    input_scale=2.0,
    raw_scale=1.0,
    channel_swap=(2, 1, 0),
)
images = [np.random.RandomState(i).rand(20, 18, 3).astype(np.float32) for i in range(3)]
predictions = classifier.predict(images, not False)
assert predictions.shape == (3, 5) and np.allclose(predictions.sum(axis=1), 1, atol=1e-5)
np.save("predictions.npy", predictions)

net = caffe.Net("deploy.prototxt", caffe.TEST, weights="small.caffemodel")
transformer = caffe.io.Transformer({"data": net.blobs["data"].data.shape})
transformer.set_transpose("data", (2, 0, 1))
transformer.set_mean("data", np.load("mean.npy").mean(1).mean(1))
transformer.set_input_scale("data", 2.0)
transformer.set_channel_swap("data", (2, 1, 0))
net.blobs["data"].reshape(1, 3, 12, 12)
centre = [caffe.io.resize_image(image, (14, 14))[1:13, 1:13] for image in images]
for image, expected in zip(centre, classifier.predict(images, oversample=False)):
    net.blobs["data"].data[...] = transformer.preprocess("data", image)
    output = net.forward()
    output_prob = output["prob"][0]
    top_inds = output_prob.argsort()[::-1][:3]
    assert np.allclose(output_prob, expected, atol=1e-5), (output_prob, expected)
assert [(k, v.data.shape) for k, v in net.blobs.items()][0] == ("data", (1, 3, 12, 12))
assert [(k, v[0].data.shape) for k, v in net.params.items()][-1] == ("fc2", (5, 36))
print("classes", predictions.argmax(axis=1).shape, top_inds.shape)
