from layers.conv import ConvLayer
