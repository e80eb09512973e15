"""ONNX export. tools/export_onnx.py is the command.

net.py exports a net, check.py compares the result with a runtime, graph.py collects operators and
constants. common.py, vision.py and hand.py translate the layers to operators.
"""
