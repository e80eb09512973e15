"""The habits of a converter of weights: it lists the layers of a net with bottoms, tops and arrays, by number."""

import pickle
import sys

import caffe
import numpy as np


def convert_caffemodel_to_dict(prototxt_filename, caffemodel_filename):
    net = caffe.Net(prototxt_filename, 1, weights=caffemodel_filename)
    layer_list = []
    for li in range(len(net.layers)):
        layer = {"name": net._layer_names[li], "type": net.layers[li].type}
        layer["bottoms"] = [
            (net._blob_names[bi], net.blobs[net._blob_names[bi]].data.shape) for bi in list(net._bottom_ids(li))
        ]
        layer["tops"] = [
            (net._blob_names[ti], net.blobs[net._blob_names[ti]].data.shape) for ti in list(net._top_ids(li))
        ]
        layer["weights"] = [blob.data[...] for blob in net.layers[li].blobs]
        layer_list.append(layer)
    return layer_list


layers = convert_caffemodel_to_dict("deploy.prototxt", "small.caffemodel")
with open("small.pkl", "wb") as file:
    pickle.dump(layers, file, protocol=2)
for layer in layers:
    print(
        layer["name"],
        layer["type"],
        [b[0] for b in layer["bottoms"]],
        layer["tops"],
        [w.shape for w in layer["weights"]],
    )
assert np.array_equal(
    layers[1]["weights"][0], caffe.Net("deploy.prototxt", "small.caffemodel", caffe.TEST).params["conv1"][0].data
)
assert "fc2" in [layer["name"] for layer in layers], sys.version
