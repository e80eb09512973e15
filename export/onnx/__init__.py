"""Nets as ONNX files. tools/export_onnx.py is the command.

net.py makes the file of a net and compares it with a runtime, graph.py collects its operators and constants. table.py
lists the layer types; activation.py, common.py, normalization.py, vision.py and hand.py have the operators of each.
"""
