class ConvLayer:
    def __init__(self, layer, params):
        options = layer.convolution_param
        pad = (
            [options.pad_h, options.pad_w]
            if options.HasField("pad_h")
            else [options.pad[0] if len(options.pad) else 0] * 2
        )
        self.attributes = {
            "kernel_shape": [options.kernel_size[0]] * 2,
            "strides": [options.stride[0] if len(options.stride) else 1] * 2,
            "pads": pad * 2,
            "group": options.group,
        }
        self.shapes = [list(param.shape.dim) for param in params]
