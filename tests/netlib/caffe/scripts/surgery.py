"""Net surgery: fully connected layers become convolutions, filters are edited, and BatchNorm is merged into them."""

import caffe
import nets
import numpy as np

net = caffe.Net("deploy.prototxt", "small.caffemodel", caffe.TEST)
params = ["fc2"]
fc_params = {pr: (net.params[pr][0].data, net.params[pr][1].data) for pr in params}
text = nets.DEPLOY.replace(
    'type: "InnerProduct" bottom: "pool1" top: "fc2"\n        inner_product_param { num_output: 5 weight_filler { type: "xavier" } }',
    'type: "Convolution" bottom: "pool1" top: "fc2"\n        convolution_param { num_output: 5 kernel_size: 3 }',
).replace('"fc2"', '"fc2-conv"')
assert "fc2-conv" in text and text.count("Convolution") == 2
open("full_conv.prototxt", "w").write(text)
net_full_conv = caffe.Net("full_conv.prototxt", "small.caffemodel", caffe.TEST)
params_full_conv = ["fc2-conv"]
conv_params = {pr: (net_full_conv.params[pr][0].data, net_full_conv.params[pr][1].data) for pr in params_full_conv}
for pr, pr_conv in zip(params, params_full_conv):
    conv_params[pr_conv][0].flat = fc_params[pr][0].flat
    conv_params[pr_conv][1][...] = fc_params[pr][1]
net_full_conv.save("full_conv.caffemodel")

image = np.random.RandomState(0).rand(1, 3, 12, 12)
for one in (net, net_full_conv):
    one.blobs["data"].reshape(*image.shape)
    one.blobs["data"].data[...] = image
small = net.forward()["prob"]
same = net_full_conv.forward()["prob"]
assert np.allclose(small, same[:, :, 0, 0], atol=1e-6)
net_full_conv.blobs["data"].reshape(1, 3, 20, 20)
net_full_conv.reshape()
assert net_full_conv.blobs["prob"].data.shape == (1, 5, 3, 3)

merged = caffe.Net("deploy.prototxt", "small.caffemodel", caffe.TEST)
mean, variance, factor = (blob.data.copy() for blob in merged.params["bn1"])
gain, shift = (blob.data.copy() for blob in merged.params["scale1"])
spread = np.sqrt(variance / factor + 1e-5)
merged.params["conv1"][0].data[...] *= (gain / spread)[:, None, None, None]
merged.params["conv1"][1].data[...] = (merged.params["conv1"][1].data - mean / factor) * gain / spread + shift
merged.params["bn1"][0].data[...], merged.params["bn1"][1].data[...], merged.params["bn1"][2].data[...] = 0, 1 - 1e-5, 1
merged.params["scale1"][0].data[...], merged.params["scale1"][1].data[...] = 1, 0
assert np.allclose(
    merged.forward(data=np.concatenate([image, image]).astype(np.float32))["prob"][0], small[0], atol=1e-5
)
print("surgery", small.argmax())
