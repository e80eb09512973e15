"""The habits of a converter to PyTorch: it turns messages into dicts by their descriptors, and keeps arrays by layer."""

import collections.abc

import numpy as np
from caffe.proto import caffe_pb2
from google.protobuf import json_format, text_format
from google.protobuf.descriptor import FieldDescriptor as FD


def to_dict(obj):
    if isinstance(obj, collections.abc.Iterable) and not isinstance(obj, (str, bytes)):
        return [to_dict(one) for one in obj]
    result = {}
    for f, v in obj.ListFields():
        if f.type == FD.TYPE_MESSAGE:
            result[f.name] = to_dict(v)
        elif f.type == FD.TYPE_ENUM:
            result[f.name] = f.enum_type.values_by_number[v].name
        else:
            result[f.name] = (
                list(v) if isinstance(v, collections.abc.Iterable) and not isinstance(v, (str, bytes)) else v
            )
    return result


net_param = text_format.Parse(open("deploy.prototxt").read(), caffe_pb2.NetParameter(), allow_unknown_extension=True)
blobs = {}
binary = caffe_pb2.NetParameter.FromString(open("small.caffemodel", "rb").read())
for layer in list(binary.layer) + list(binary.layers):
    blobs[layer.name] = [np.array(b.data, np.float32).reshape(tuple(b.shape.dim)) for b in layer.blobs]
found = {layer.name: to_dict(layer) for layer in net_param.layer}
assert found["conv1"]["convolution_param"]["weight_filler"] == {"type": "xavier"}
assert found["pool1"]["pooling_param"] == {"pool": "MAX", "kernel_size": 2, "stride": 2}
assert (
    json_format.MessageToDict(net_param, preserving_proto_field_name=True)["layer"][5]["inner_product_param"][
        "num_output"
    ]
    == 5
)
assert [b.shape for b in blobs["bn1"]] == [(4,), (4,), (1,)]
assert caffe_pb2.LayerParameter.DESCRIPTOR.fields_by_name["lrn_param"].message_type.name == "LRNParameter"
print(sorted(blobs))
