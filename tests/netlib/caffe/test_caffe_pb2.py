"""caffe_pb2: classes of protobuf, built from the dataclasses that read and write the files
of this project.
"""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, json_format, message, text_format

from netlib.caffe.proto import caffe_pb2, forks
from netlib.caffe.proto.caffe_pb2 import _name_of
from netlib.proto import messages, schema, upgrade, wire
from netlib.proto.options import option_blocks

DATACLASSES = {
    **{cls.__name__: cls for cls in option_blocks().values()},
    **{
        name: getattr(messages, name)
        for name in ("BlobProto", "Datum", "SolverState", "ParamSpec", "LayerParameter")
    },
    "NetParameter": upgrade.AnyNetParameter,
    "SolverParameter": messages.SolverParameter,
    "V1LayerParameter": upgrade.V1LayerParameter,
}


def layer() -> Any:
    made = caffe_pb2.LayerParameter(name="c", bottom=["x"])
    made.convolution_param.kernel_size.extend([3, 5])
    made.convolution_param.weight_filler.type = "xavier"
    made.pooling_param.pool = caffe_pb2.PoolingParameter.AVE
    return made


@pytest.mark.parametrize("name", list(DATACLASSES))
def test_fields_are_those_of_the_dataclass(name: str) -> None:
    fields = getattr(caffe_pb2, name).DESCRIPTOR.fields_by_name
    for declared, known in wire.fields_of(DATACLASSES[name]).items():
        field = fields[declared]
        assert field.number == known.number
        values = schema.enum_of(known.kind)
        assert not values or {v.name: v.number for v in field.enum_type.values} == values


@pytest.mark.parametrize("name", list(DATACLASSES))
def test_defaults_are_those_of_the_dataclass(name: str) -> None:
    cls = DATACLASSES[name]
    made = getattr(caffe_pb2, name)()
    defaults = {schema.written_name(f.name): f.default for f in dataclasses.fields(cls)}
    for known in wire.fields_of(cls).values():
        default = defaults.get(known.name)
        is_default = default not in (None, dataclasses.MISSING)
        is_scalar = not known.repeated and not schema.is_message(known.kind)
        if not is_default or not is_scalar or known.name == "solver_mode":  # GPU in Caffe
            continue
        values = schema.enum_of(known.kind)
        expected = values[default] if values else default
        if known.kind is float:
            expected = pytest.approx(expected)
        assert getattr(made, known.name) == expected


def test_old_nets_are_read() -> None:
    net = text_format.Parse(
        'layers { name: "r" type: RELU bottom: "x" top: "y" }', caffe_pb2.NetParameter()
    )
    assert net.layers[0].type == caffe_pb2.V1LayerParameter.RELU == 18
    assert caffe_pb2.V1LayerParameter.LayerType.Name(18) == "RELU"


def test_messages_are_converted_copied_and_pickled() -> None:
    made = layer()
    assert isinstance(made, message.Message)
    assert json_format.Parse(json_format.MessageToJson(made), caffe_pb2.LayerParameter()) == made
    assert json_format.MessageToDict(made)["poolingParam"] == {"pool": "AVE"}
    assert pickle.loads(pickle.dumps(made)) == copy.deepcopy(made) == made


def test_invalid_bytes_are_rejected() -> None:
    with pytest.raises(message.DecodeError):
        caffe_pb2.NetParameter().ParseFromString(b"\xff\xff")


def test_descriptors_and_constants_have_the_names_that_protobuf_gives_them() -> None:
    of_file = caffe_pb2.DESCRIPTOR.message_types_by_name
    assert of_file["NetParameter"] is caffe_pb2.NetParameter.DESCRIPTOR
    methods = caffe_pb2._POOLINGPARAMETER_POOLMETHOD.values
    assert [value.name for value in methods] == ["MAX", "AVE", "STOCHASTIC"]
    assert (caffe_pb2.TRAIN, caffe_pb2.TEST, caffe_pb2.Phase.Name(1)) == (0, 1, "TEST")
    assert caffe_pb2.LayerParameter.CONVOLUTION_PARAM_FIELD_NUMBER == 106


def test_repeated_fields_have_the_methods_of_lists() -> None:
    made = layer()
    net = caffe_pb2.NetParameter(layer=[made, caffe_pb2.LayerParameter(name="d")])
    net.layer.reverse()
    assert [one.name for one in net.layer] == ["d", "c"]
    made.loss_weight.extend(np.float32([0.5]))
    assert made.loss_weight[0] == 0.5


def test_a_script_can_load_its_own_caffe_pb2_too() -> None:
    """A script's own compiled caffe_pb2 can be loaded too: the descriptors are in a
    pool of their own.
    """
    from google.protobuf import descriptor_pool

    other = caffe_pb2.file_descriptor()
    other.message_type[0].field[0].name = "dimension"
    pool = descriptor_pool.Default()
    pool.Add(other)
    assert pool.FindMessageTypeByName("caffe.BlobShape").fields[0].name == "dimension"
    assert caffe_pb2.BlobShape.DESCRIPTOR.fields[0].name == "dim"


def test_messages_inside_the_options_of_a_fork_are_defined() -> None:
    """Messages that only options contain are defined, and the enum that two layer types use is
    where scripts look.
    """
    made = caffe_pb2.LayerParameter(type="DetectionOutput")
    made.detection_output_param.nms_param.top_k = 400
    made.detection_output_param.save_output_param.resize_param.resize_mode = (
        caffe_pb2.ResizeParameter.FIT_SMALL_SIZE
    )
    made.detection_output_param.code_type = caffe_pb2.PriorBoxParameter.CENTER_SIZE
    assert made.detection_output_param.nms_param.nms_threshold == pytest.approx(0.3)
    text = str(wire.decode(made.SerializeToString(), messages.LayerParameter))
    assert text_format.Parse(text, caffe_pb2.LayerParameter()) == made
    assert caffe_pb2.PriorBoxParameter.CodeType.items() == [
        ("CORNER", 1),
        ("CENTER_SIZE", 2),
        ("CORNER_SIZE", 3),
    ]


def test_fields_of_forks_do_not_collide_with_declared_ones() -> None:
    """They are declared once, and no layer of this project reads them."""
    classes = [*option_blocks().values(), messages.LayerParameter, messages.SolverParameter]
    known = {_name_of(cls): cls for cls in classes}
    added = descriptor_pb2.FileDescriptorProto()
    forks.add_to(added)
    for fork in added.message_type:
        declared = wire.fields_of(known[fork.name]).keys() if fork.name in known else set()
        assert not declared & {field.name for field in fork.field}
        numbers = [field.number for field in getattr(caffe_pb2, fork.name).DESCRIPTOR.fields]
        assert len(numbers) == len(set(numbers))
    assert {"LayerParameter", "SolverParameter"} <= {fork.name for fork in added.message_type}


def test_options_of_refinedet_are_written_and_parsed() -> None:
    """As its scripts write them by NetSpec."""
    made = caffe_pb2.LayerParameter()
    made.multibox_loss_param.objectness_score = 0.5
    made.detection_output_param.objectness_score = 0.5
    assert text_format.Parse(str(made), caffe_pb2.LayerParameter()) == made


def test_a_solver_of_ssd_is_parsed() -> None:
    text = 'net: "n" eval_type: "detection" ap_version: "11point" show_per_class_result: true'
    assert text_format.Parse(text, caffe_pb2.SolverParameter()).ap_version == "11point"


def test_label_maps_and_annotations_of_ssd_are_read_and_written() -> None:
    """As ssd_detect.py and create_annoset read and write them."""
    names = text_format.Parse(
        'item { name: "none" label: 0 } item { name: "n1" label: 1 display_name: "hand" }',
        caffe_pb2.LabelMap(),
    )
    assert [(item.label, item.display_name or item.name) for item in names.item] == [
        (0, "none"),
        (1, "hand"),
    ]
    made = caffe_pb2.AnnotatedDatum(
        type=caffe_pb2.AnnotatedDatum.BBOX, datum=caffe_pb2.Datum(label=3)
    )
    box = made.annotation_group.add(group_label=1).annotation.add(instance_id=2).bbox
    box.xmin, box.ymax, box.difficult = 0.25, 0.5, True
    assert caffe_pb2.AnnotatedDatum.FromString(made.SerializeToString()) == made
    # fields 1, 4 and 6
    assert box.SerializeToString().hex() == "0d0000803e" + "250000003f" + "3001"
