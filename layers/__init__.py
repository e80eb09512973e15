"""The layers, and the table of their types.

Sub-packages follow Caffe's layer catalogue: data, vision, activation, normalization, recurrent,
common, loss. ``detection`` holds layers of the SSD branch, ``hand`` the layers of this project. The
file of a layer is imported when a net has one.
"""

from netlib.proto.options import LayerTable

# type -> folder.file.class
LAYER_TYPES = LayerTable(
    {
        "AbsVal": "activation.absval.AbsVal",
        "Accuracy": "loss.accuracy.Accuracy",
        "ArgMax": "common.argmax.ArgMax",
        "Axpy": "common.axpy.Axpy",  # from SENet
        "BN": "normalization.bn.BN",  # from SegNet and PSPNet
        "BNLL": "activation.bnll.BNLL",
        "BatchNorm": "normalization.batch_norm.BatchNorm",
        "BatchReindex": "common.batch_reindex.BatchReindex",
        "Bias": "activation.bias.Bias",
        "Clip": "activation.clip.Clip",
        "Concat": "common.concat.Concat",
        "ContrastiveLoss": "loss.contrastive_loss.ContrastiveLoss",
        "Convolution": "vision.convolution.Convolution",
        # from MobileNet's forks
        "ConvolutionDepthwise": "vision.depthwise_convolution.ConvolutionDepthwise",
        "Crop": "vision.crop.Crop",
        "Data": "data.data.Data",
        "Deconvolution": "vision.deconvolution.Deconvolution",
        "DeepHandModel": "hand.hand_model.HandModel",  # name in the released system
        # name in the released system
        "DeepHandModelDofConstraintLoss": "hand.phys_limit.ReleasedPhysLimit",
        "DetectionOutput": "detection.detection_output.DetectionOutput",  # from SSD
        # from MobileNet's forks
        "DepthwiseConvolution": "vision.depthwise_convolution.DepthwiseConvolution",
        "Dropout": "common.dropout.Dropout",
        "DummyData": "data.dummy_data.DummyData",
        "ELU": "activation.elu.ELU",
        "Eltwise": "common.eltwise.Eltwise",
        "Embed": "common.embed.Embed",
        "EuclideanLoss": "loss.euclidean_loss.EuclideanLoss",
        "Exp": "activation.exp.Exp",
        "Filter": "common.filter.Filter",
        "Flatten": "common.flatten.Flatten",
        "HDF5Data": "data.hdf5_data.HDF5Data",
        "HDF5Output": "data.hdf5_output.HDF5Output",
        "HandAugment": "hand.augment.HandAugment",
        "HandModel": "hand.hand_model.HandModel",
        "HingeLoss": "loss.hinge_loss.HingeLoss",
        "Im2col": "vision.im2col.Im2col",
        "ImageData": "data.image_data.ImageData",
        "InfogainLoss": "loss.infogain_loss.InfogainLoss",
        "InnerProduct": "common.inner_product.InnerProduct",
        "Input": "data.input.Input",
        "Interp": "vision.interp.Interp",  # from DeepLab and PSPNet
        "LRN": "normalization.lrn.LRN",
        "LSTM": "recurrent.lstm.LSTM",
        "LSTMUnit": "recurrent.lstm_unit.LSTMUnit",
        "Log": "activation.log.Log",
        "MVN": "normalization.mvn.MVN",
        "MemoryData": "data.memory_data.MemoryData",
        "MultinomialLogisticLoss": "loss.multinomial_logistic_loss.MultinomialLogisticLoss",
        "Normalize": "normalization.normalize.Normalize",  # from SSD
        "PReLU": "activation.prelu.PReLU",
        "PSROIPooling": "vision.psroi_pooling.PSROIPooling",  # from R-FCN
        "Parameter": "common.parameter.Parameter",
        "Permute": "common.permute.Permute",  # from SSD
        "PhysLimit": "hand.phys_limit.PhysLimit",
        "Pooling": "vision.pooling.Pooling",
        "Power": "activation.power.Power",
        "PriorBox": "detection.prior_box.PriorBox",  # from SSD
        "RNN": "recurrent.rnn.RNN",
        "ROIPooling": "vision.roi_pooling.ROIPooling",  # from Fast R-CNN
        "ReLU": "activation.relu.ReLU",
        "ReLU6": "activation.relu6.ReLU6",  # from MobileNet's forks
        "Reduction": "common.reduction.Reduction",
        "Reshape": "common.reshape.Reshape",
        "SPP": "vision.spp.SPP",
        "Scale": "activation.scale.Scale",
        "ShuffleChannel": "common.shuffle_channel.ShuffleChannel",  # from ShuffleNet
        "Sigmoid": "activation.sigmoid.Sigmoid",
        "SigmoidCrossEntropyLoss": "loss.sigmoid_cross_entropy_loss.SigmoidCrossEntropyLoss",
        "Silence": "common.silence.Silence",
        "Slice": "common.slice.Slice",
        "SmoothL1Loss": "loss.smooth_l1_loss.SmoothL1Loss",
        "Softmax": "common.softmax.Softmax",
        "SoftmaxWithLoss": "loss.softmax_loss.SoftmaxWithLoss",
        "Split": "common.split.Split",
        "Swish": "activation.swish.Swish",
        "TanH": "activation.tanh.TanH",
        "Threshold": "activation.threshold.Threshold",
        "Tile": "common.tile.Tile",
        "Upsample": "vision.upsample.Upsample",  # from SegNet
    }
)

# Types with a different class for some number of bottoms.
BY_BOTTOMS = LayerTable(
    {
        ("DeepHandModel", 2): "hand.sized_hand_model.SizedHandModel",
        ("HandModel", 2): "hand.sized_hand_model.SizedHandModel",
        ("Upsample", 1): "vision.nearest_upsample.NearestUpsample",  # from YOLO's forks
    }
)

# Options blocks that are not called after a layer type, and a type that defines each.
BLOCK_OWNERS = {
    "argmax_param": "ArgMax",
    "hdf5_data_param": "HDF5Data",
    "hdf5_output_param": "HDF5Output",
    "norm_param": "Normalize",
    "prelu_param": "PReLU",
    "recurrent_param": "RNN",
    "relu6_param": "ReLU6",
    "relu_param": "ReLU",
    "smooth_l1_loss_param": "SmoothL1Loss",
    "tanh_param": "TanH",
    "transform_param": "Data",
}
