"""The habits of a converter to ONNX: it reads text and binary with caffe_pb2, and has a package ``layers`` of its own."""

import copy

import numpy as np
from caffe.proto import caffe_pb2
from google.protobuf import text_format

import layers as Layers


def loadcaffemodel(net_path, model_path):
    net = caffe_pb2.NetParameter()
    text_format.Merge(open(net_path).read(), net)
    model = caffe_pb2.NetParameter()
    f = open(model_path, "rb")
    model.ParseFromString(f.read())
    f.close()
    return net, model


net, model = loadcaffemodel("deploy.prototxt", "small.caffemodel")
net_layers = net.layer if len(net.layer) else net.layers
weights = {layer.name: layer.blobs for layer in model.layer}
inputs = {name: list(net.input_dim[4 * i : 4 * i + 4]) for i, name in enumerate(net.input)}
nodes = []
for index, layer in enumerate(copy.deepcopy(net_layers)):
    if layer.type == "Convolution":
        nodes.append(Layers.ConvLayer(layer, weights[layer.name]).attributes)
    elif layer.type == "Pooling":
        kind = layer.pooling_param.PoolMethod.Name(layer.pooling_param.pool)
        assert layer.pooling_param.pool == caffe_pb2.PoolingParameter.MAX
        nodes.append({"op": f"{kind}Pool", "ceil": not layer.pooling_param.HasField("round_mode")})
    nodes[-1:] = [*nodes[-1:]]
assert inputs == {"data": [2, 3, 12, 12]}
assert nodes[0] == {"kernel_shape": [3, 3], "strides": [2, 2], "pads": [1, 1, 1, 1], "group": 1}
assert nodes[1] == {"op": "MAXPool", "ceil": True}
kernel = np.array(weights["conv1"][0].data, dtype=np.float32).reshape(weights["conv1"][0].shape.dim)
assert kernel.shape == (4, 3, 3, 3)
del net.layer[-1]
net.layer.add(name="out", type="Sigmoid", bottom=["fc2"], top=["out"])
open("changed.prototxt", "w").write(text_format.MessageToString(net))
open("changed.caffemodel", "wb").write(model.SerializeToString())
assert open("changed.caffemodel", "rb").read() == open("small.caffemodel", "rb").read()
print(Layers.__file__.split("/")[-2:], nodes)
