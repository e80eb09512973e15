"""Caffe's messages as classes of the package protobuf."""

from typing import Any


def __getattr__(name: str) -> Any:
    """Import ``caffe_pb2`` at its first use: only it needs protobuf."""
    if name != "caffe_pb2":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import netlib.caffe.proto.caffe_pb2 as module

    return module
