"""Caffe's messages as Python objects: caffe.proto.caffe_pb2."""
