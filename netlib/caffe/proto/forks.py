"""Fields of public forks of Caffe that scripts write to nets and solvers, and that layers of this
project do not read.

They are in caffe_pb2 and NetSpec only, so that a fork's scripts can write and parse its nets. A net
with them is an error where it is built, unless the option is one without effect
(netlib/proto/forks.py). From the files caffe.proto of SSD, MobileNet-YOLO, NVIDIA, Intel, SegNet,
ENet, DeepLab and PSPNet, LRCN, TSN, caffe-heatmap, caffe-face, R-FCN, CRF-RNN, crnn, FlowNet 2,
CPM, OpenPose, RefineDet and caffe-windows.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

FIRST_FREE = 20001  # number of the first field whose numbers in the forks are those of other fields

# Message: name, type and number of each field; "*" repeats it, and "/" separates the numbers of
# several forks, of which the first free one is used. A line begins with a message or a field.
# Defaults are left out, which matter to the fork's layers only.
MESSAGES = """
Datum: seg_label bytes 8, record_id uint32 8
FillerParameter: diag_val float* 9, scale float 9
NetParameter: default_forward_type BlobProto.Type 11, default_backward_type BlobProto.Type 12,
  default_forward_math BlobProto.Type 13, default_backward_math BlobProto.Type 14, global_grad_scale float 15,
  global_grad_scale_adaptive bool 16, default_conv_algos_override string 17, reduce_buckets int32 18,
  default_cudnn_math_override int32 19, eltwise_mem_sharing bool 20, mem_param MemoryOptimizationParameter 200,
  engine string 9, bn_stats_batch_size uint32 11
MemoryOptimizationParameter: optimize_train bool 1, optimize_test bool 2, exclude_blob string* 3
SolverParameter: eval_type string 41/52/241, ap_version string 42/53/242, show_per_class_result bool 44/244/43,
  plateau_winsize int32* 43/243/44, stagelr float* 50/150, stageiter int32* 51/151, min_lr float 43,
  momentum_policy string 46, max_momentum float 47, momentum_power float 48, larc bool 49, larc_policy string 50,
  larc_eta float 51, larc_turbo bool 55, weight_decay_policy string 52, weight_decay_power float 53,
  max_weight_decay float 56, solver_data_type BlobProto.Type 44, store_blobs_in_old_format bool 45,
  test_and_snapshot_last_epochs int32 54, group_id int32* 38, richness int32 37, disabled_update bool 46,
  engine string 47, warmup_iter int32 48, warmup_start_lr float 49, local_lr_auto bool 50, local_gw_ratio float 51,
  test_offset int32 52
LayerParameter: annotated_data_param AnnotatedDataParameter 200,
  detection_evaluate_param DetectionEvaluateParameter 205, multibox_loss_param MultiBoxLossParameter 201,
  video_data_param VideoDataParameter 207/140, window_data_param WindowDataParameter 129,
  region_loss_param RegionLossParameter 600/209, yolov3_param Yolov3Parameter 603, yolo_seg_param YoloSegParameter 604,
  segmentation_evaluate_param SegmentationEvaluateParameter 605,
  yolo_detection_output_param YoloDetectionOutputParameter 601,
  yolov3_detection_output_param Yolov3DetectionOutputParameter 602, reorg_param ReorgParameter 149/159,
  forward_type BlobProto.Type 145, backward_type BlobProto.Type 146, forward_math BlobProto.Type 147,
  backward_math BlobProto.Type 148, trt_param TRTParameter 152,
  detectnet_groundtruth_param DetectNetGroundTruthParameter 6801,
  detectnet_augmentation_param DetectNetAugmentationParameter 6802,
  dense_image_data_param DenseImageDataParameter 138/46, bias_channel_param BiasChannelParameter 149,
  dense_crf_param DenseCRFParameter 146, domain_transform_param DomainTransformParameter 147,
  mat_read_param MatReadParameter 151, mat_write_param MatWriteParameter 145,
  seg_accuracy_param SegAccuracyParameter 144, unique_label_param UniqueLabelParameter 150,
  seg_data_param SegDataParameter 141, batch_reduction_param BatchReductionParameter 162, visualise bool 200,
  visualise_channel uint32 201, heatmap_data_param HeatmapDataParameter 140,
  center_loss_param CenterLossParameter 147/211, box_annotator_ohem_param BoxAnnotatorOHEMParameter 10000/152,
  multi_stage_meanfield_param MultiStageMeanfieldParameter 146, ctc_loss_param CtcLossParameter 200,
  continuation_indicator_param ContinuationIndicatorParameter 201,
  labelsequence_accuracy_param LabelsequenceAccuracyParameter 203, coeff_schedule_param CoeffScheduleParameter 148,
  augmentation_param AugmentationParameter 149, correlation_param CorrelationParameter 150,
  l1_loss_param L1LossParameter 151, writer_param WriterParameter 152, reader_param ReaderParameter 153,
  mean_param MeanParameter 154, resample_param ResampleParameter 155, downsample_param DownsampleParameter 156,
  lpq_loss_param LpqLossParameter 158, flow_warp_param FlowWarpParameter 159, accum_param AccumParameter 160,
  black_augmentation_param BlackAugmentationParameter 161, cpm_transform_param CPMTransformationParameter 147,
  op_transform_param OPTransformationParameter 149, spatial_dropout_param SpatialDropoutParameter 155,
  engine string 149, quantization_param QuantizationParameter 158, eval_detection_param EvalDetectionParameter 301,
  local_param LocalParameter 201, triplet_loss_param TripletLossParameter 203,
  eltwise_affine_param EltwiseAffineParameter 205, flip_param FlipParameter 212,
  inner_distance_param InnerDistanceParameter 213, proposal_param ProposalParameter 219,
  largemargin_inner_product_param LargeMarginInnerProductParameter 227,
  margin_inner_product_param MarginInnerProductParameter 232, focal_loss_param FocalLossParameter 235,
  label_specific_margin_param LabelSpecificMarginParameter 236, label_specific_add_param LabelSpecificAddParameter 241
AnnotatedDataParameter: batch_sampler BatchSampler* 1, label_map_file string 2,
  anno_type AnnotatedDatum.AnnotationType 3, yolo_data_type int32 4, yolo_data_jitter float 5, train_diffcult bool 6,
  single_class bool 7, seg_scales int32 8, seg_resize_width int32 9, seg_resize_height int32 10,
  difficult_label_warmup bool 11
BatchSampler: use_original_image bool 1, sampler Sampler 2, sample_constraint SampleConstraint 3, max_sample uint32 4,
  max_trials uint32 5
Sampler: min_scale float 1, max_scale float 2, min_aspect_ratio float 3, max_aspect_ratio float 4
SampleConstraint: min_jaccard_overlap float 1, max_jaccard_overlap float 2, min_sample_coverage float 3,
  max_sample_coverage float 4, min_object_coverage float 5, max_object_coverage float 6
DetectionEvaluateParameter: num_classes uint32 1, background_label_id uint32 2, overlap_threshold float 3,
  evaluate_difficult_gt bool 4, name_size_file string 5, resize_param ResizeParameter 6
MultiBoxLossParameter: loc_loss_type LocLossType 1, conf_loss_type ConfLossType 2, loc_weight float 3,
  num_classes uint32 4, share_location bool 5, match_type MatchType 6, overlap_threshold float 7,
  use_prior_for_matching bool 8, background_label_id uint32 9, use_difficult_gt bool 10, do_neg_mining bool 11,
  neg_pos_ratio float 12, neg_overlap float 13, code_type PriorBoxParameter.CodeType 14,
  encode_variance_in_target bool 16, map_object_to_agnostic bool 17, ignore_cross_boundary_bbox bool 18,
  bp_inside bool 19, mining_type MiningType 20, nms_param NonMaximumSuppressionParameter 21, sample_size int32 22,
  use_prior_for_nms bool 23, ignore_difficult_gt bool 24, objectness_score float 24
DetectionOutputParameter: objectness_score float 24
VideoDataParameter: video_type VideoType 1, device_id int32 2, video_file string 3, skip_frames uint32 4,
  source string 1, batch_size uint32 4, rand_skip uint32 7, shuffle bool 8, new_height uint32 9, new_width uint32 10,
  new_length uint32 11, num_segments uint32 12, scale float 2, mean_file string 3, crop_size uint32 5, mirror bool 6,
  modality Modality 13, name_pattern string 14, encoded bool 15, grayscale bool 16
WindowDataParameter: source string 1, scale float 2, mean_file string 3, batch_size uint32 4, crop_size uint32 5,
  mirror bool 6, fg_threshold float 7, bg_threshold float 8, fg_fraction float 9, context_pad uint32 10,
  crop_mode string 11, cache_images bool 12, root_folder string 13
RegionLossParameter: side uint32 1, num_class uint32 2, bias_match uint32 3, coords uint32 4, num uint32 5,
  softmax uint32 6, jitter float 7, rescore uint32 8, object_scale float 9, class_scale float 10,
  noobject_scale float 11, coord_scale float 12, absolute uint32 13, thresh float 14, random uint32 15,
  biases float* 16, softmax_tree string 17, class_map string 18
Yolov3Parameter: side uint32 1, num_class uint32 2, num uint32 3, object_scale float 4, class_scale float 5,
  noobject_scale float 6, coord_scale float 7, thresh float 8, anchors_scale uint32 10, biases float* 11,
  mask uint32* 12, use_logic_gradient bool 13, use_focal_loss bool 14, iou_loss IOU_LOSS 15, iou_normalizer float 16,
  iou_thresh float 17, max_delta float 18, accumulate bool 19, label_smooth_eps float 20
YoloSegParameter: num_class uint32 1, object_scale float 2, class_scale float 3, use_logic_gradient bool 4,
  use_hardsigmoid bool 5
SegmentationEvaluateParameter: num_classes uint32 1, threshold float 2
YoloDetectionOutputParameter: side uint32 1, num_classes uint32 2, num_box uint32 3, coords uint32 4,
  confidence_threshold float 5, nms_threshold float 6, biases float* 7, label_map_file string 8
Yolov3DetectionOutputParameter: num_classes uint32 1, num_box uint32 2, confidence_threshold float 3,
  nms_threshold float 4, biases float* 5, anchors_scale uint32* 6, mask_group_num uint32 7, mask uint32* 8,
  gaussian_box bool 9
ReorgParameter: stride uint32 1, reverse bool 2
TRTParameter: trt_mode TRTMode 1, top_k uint32 2, deploy string 3, model string 4, deploy_outputs string* 5,
  calibrator string 6
DetectNetGroundTruthParameter: stride uint32 1, scale_cvg float 2, gridbox_type GridboxType 3, max_cvg_len uint32 4,
  min_cvg_len uint32 5, coverage_type CoverageType 7, image_size_x uint32 8, image_size_y uint32 9, obj_norm bool 11,
  crop_bboxes bool 12, object_class ClassMapping* 13
DetectNetGroundTruthParameter.ClassMapping: src uint32 1, dst uint32 2
DetectNetAugmentationParameter: crop_prob float 1, shift_x uint32 2, shift_y uint32 3, scale_prob float 4,
  scale_min float 5, scale_max float 6, flip_prob float 7, rotation_prob float 8, max_rotate_degree float 9,
  hue_rotation_prob float 10, hue_rotation float 11, desaturation_prob float 12, desaturation_max float 13,
  resize_param ResizeParameter 208, noise_param NoiseParameter 209, distort_param DistortionParameter 213,
  expand_param ExpansionParameter 214, emit_constraint EmitConstraint 210
NoiseParameter: prob float 1, hist_eq bool 2, inverse bool 3, decolorize bool 4, gauss_blur bool 5, jpeg float 6,
  posterize bool 7, erode bool 8, saltpepper bool 9, saltpepper_param SaltPepperParameter 10, clahe bool 11,
  convert_to_hsv bool 12, convert_to_lab bool 13
SaltPepperParameter: fraction float 1, value float* 2
DistortionParameter: brightness_prob float 1, brightness_delta float 2, contrast_prob float 3, contrast_lower float 4,
  contrast_upper float 5, hue_prob float 6, hue_delta float 7, saturation_prob float 8, saturation_lower float 9,
  saturation_upper float 10, random_order_prob float 11
ExpansionParameter: prob float 1, max_expand_ratio float 2
EmitConstraint: emit_type EmitType 1, emit_overlap float 2
DenseImageDataParameter: source string 1, batch_size uint32 2, rand_skip uint32 3, shuffle bool 4, new_height uint32 5,
  new_width uint32 6, is_color bool 7, mean_file string 8, root_folder string 9, mirror bool 10, crop_width uint32 11,
  crop_height uint32 12, label_divide_factor uint32 13
BiasChannelParameter: bg_bias float 1, fg_bias float 2, ignore_label int32* 3, label_type LabelType 4,
  background_label int32 6
DenseCRFParameter: max_iter int32 1, pos_xy_std float* 2, pos_w float* 3, bi_xy_std float* 4, bi_rgb_std float* 5,
  bi_w float* 6, output_probability bool 7
DomainTransformParameter: num_iter int32 1, spatial_sigma float 2, range_sigma float 3, min_weight float 4
MatReadParameter: prefix string 1, source string 2, strip int32 3, batch_size int32 4
MatWriteParameter: prefix string 1, source string 2, strip int32 3, period int32 4
SegAccuracyParameter: metric AccuracyMetric 1, ignore_label int32* 2, reset bool 3
UniqueLabelParameter: max_labels int32 1, ignore_label int32* 2, force_label float* 3
SegDataParameter: source string 1, root_dir string 2, shuffle bool 3, balance bool 4
BatchReductionParameter: level int32* 1, reduction_param ReductionParameter 2, pos bool 3
ReductionParameter: k int32 4
HeatmapDataParameter: segmentation bool 1000, multfact uint32 1001, num_channels uint32 1002, batchsize uint32 1003,
  root_img_dir string 1004, random_crop bool 1005, sample_per_cluster bool 1006, labelinds string 1007,
  source string 1008, meanfile string 1009, crop_meanfile string 1010, cropsize uint32 1011, outsize uint32 1012,
  scale float 1013, label_width uint32 1014, label_height uint32 1015, dont_flip_first bool 1016, angle_max float 1017,
  flip_joint_labels bool 1018
CenterLossParameter: num_output uint32 1, center_filler FillerParameter 2, axis int32 3, distance_type string 29
BoxAnnotatorOHEMParameter: roi_per_img uint32 1, ignore_label int32 2
MultiStageMeanfieldParameter: compatibility_mode Mode 1, threshold float 2, theta_alpha float 3, theta_beta float 4,
  theta_gamma float 5, num_iterations uint32 6, spatial_filter_weight float 7, bilateral_filter_weight float 8,
  forced_spatial_filter_weight float 9, forced_bilateral_filter_weight float 10
CtcLossParameter: alphabet_size uint32 1, time_step uint32 3, blank_label int32 4
ContinuationIndicatorParameter: time_step uint32 1, batch_size uint32 2
LabelsequenceAccuracyParameter: blank_label int32 1
CoeffScheduleParameter: half_life float 1, initial_coeff float 2, final_coeff float 3
AugmentationParameter: crop_width uint32 33, crop_height uint32 34, write_augmented string 2, max_multiplier float 3,
  augment_during_test bool 4, recompute_mean uint32 5, write_mean string 6, mean_per_pixel bool 7, mean float* 18,
  mode string 8, bottomwidth uint32 80, bottomheight uint32 81, num uint32 82, chromatic_eigvec float* 83,
  mirror RandomGeneratorParameter 10, translate RandomGeneratorParameter 11, rotate RandomGeneratorParameter 12,
  zoom RandomGeneratorParameter 13, squeeze RandomGeneratorParameter 14, translate_x RandomGeneratorParameter 15,
  translate_y RandomGeneratorParameter 16, gamma RandomGeneratorParameter 35, brightness RandomGeneratorParameter 36,
  contrast RandomGeneratorParameter 37, color RandomGeneratorParameter 38, lmult_pow RandomGeneratorParameter 20,
  lmult_mult RandomGeneratorParameter 21, lmult_add RandomGeneratorParameter 22, sat_pow RandomGeneratorParameter 23,
  sat_mult RandomGeneratorParameter 24, sat_add RandomGeneratorParameter 25, col_pow RandomGeneratorParameter 26,
  col_mult RandomGeneratorParameter 27, col_add RandomGeneratorParameter 28, ladd_pow RandomGeneratorParameter 29,
  ladd_mult RandomGeneratorParameter 30, ladd_add RandomGeneratorParameter 31, col_rotate RandomGeneratorParameter 32,
  fog_amount RandomGeneratorParameter 100, fog_size RandomGeneratorParameter 101,
  motion_blur_angle RandomGeneratorParameter 102, motion_blur_size RandomGeneratorParameter 103,
  shadow_angle RandomGeneratorParameter 104, shadow_distance RandomGeneratorParameter 105,
  shadow_strength RandomGeneratorParameter 106, noise RandomGeneratorParameter 107
RandomGeneratorParameter: rand_type string 1, exp bool 2, mean float 4, spread float 5, prob float 6,
  apply_schedule bool 7, discretize bool 8, multiplier float 9
CorrelationParameter: pad uint32 2, kernel_size uint32 3, max_displacement uint32 4, stride_1 uint32 5,
  stride_2 uint32 6, single_direction int32 8, do_abs bool 7, correlation_type CorrelationType 15
L1LossParameter: l2_per_location bool 1, l2_prescale_by_channels bool 2, normalize_by_num_entries bool 3,
  epsilon float 4, plateau float 3001
WriterParameter: file string 1, folder string 2, prefix string 3, suffix string 4, normalize bool 5, scale float 6
ReaderParameter: file string 1, num uint32 2
MeanParameter: operation MeanOperation 1, file string 2, value float* 3, mean_scale float 4, input_scale float 5,
  output_scale float 6
ResampleParameter: antialias bool 4, width uint32 1, height uint32 2, type ResampleType 3, factor float 5
DownsampleParameter: top_height uint32 1, top_width uint32 2
LpqLossParameter: l2_prescale_by_channels bool 4016, normalize_by_num_entries bool 4017, p_epsilon float 4013,
  q_epsilon float 4014, pq_episode_starts_at_iter uint32* 4010, p float* 4011, q float* 4012
FlowWarpParameter: fill_value FillParameter 1
AccumParameter: top_height uint32 1, top_width uint32 2, size_divisible_by uint32 3, have_reference bool 4
BlackAugmentationParameter: black RandomGeneratorParameter 10, border RandomGeneratorParameter 11
CPMTransformationParameter: scale float 1, mirror bool 2, crop_size uint32 3, mean_file string 4, mean_value float* 5,
  stride uint32 6, scale_cvg float 7, max_cvg_len uint32 8, min_cvg_len uint32 9, opaque_coverage bool 10,
  coverage string 11, flip_prob float 12, max_rotate_degree float 13, visualize bool 14, crop_size_x uint32 15,
  crop_size_y uint32 16, scale_prob float 17, scale_min float 18, scale_max float 19, bbox_norm_factor float 20,
  img_header string 21, force_color bool 22, force_gray bool 23, target_dist float 24, center_perterb_max float 25,
  sigma float 26, sigma_center float 27, clahe_tile_size float 28, clahe_clip_limit float 29, do_clahe bool 30,
  num_parts uint32 31, num_total_augs uint32 32, aug_way string 33, gray uint32 34, np_in_lmdb uint32 35,
  transform_body_joint bool 38
OPTransformationParameter: stride uint32 8, flip_prob float 9, max_degree_rotations string 10, crop_size_x uint32 12,
  crop_size_y uint32 13, center_perterb_max float 14, center_swap_prob float 15, scale_prob float 16,
  scale_mins string 17, scale_maxs string 18, target_dist float 19, number_max_occlusions string 20, sigmas string 21,
  models string 22, sources string 23, probabilities string 24, source_background string 25,
  prob_only_background float 26, media_directory string 27, normalization uint32 28, add_distance bool 29,
  input_type string 30, frame_size uint32 31, taf_topology uint32 32
SpatialDropoutParameter: dropout_ratio float 1
QuantizationParameter: precision Precision 1, rounding_scheme Rounding 2, bw_layer_in uint32 3, bw_layer_out uint32 4,
  bw_params uint32 5, fl_layer_in int32* 6, fl_layer_out int32* 7, fl_params int32* 8, scale_in float* 20,
  scale_out float* 21, scale_params float* 22, is_negative_input bool 23, force_u8_input bool 24
EvalDetectionParameter: side uint32 1, num_class uint32 2, num_object uint32 3, threshold float 4, sqrt bool 5,
  score_type ScoreType 7, nms float 8, biases float* 9
LocalParameter: num_output uint32 1, bias_term bool 2, pad uint32 3, kernel_size uint32 4, stride uint32 6,
  weight_filler FillerParameter 7, bias_filler FillerParameter 8
TripletLossParameter: margin float 1
EltwiseAffineParameter: slope_filler FillerParameter 1, bias_filler FillerParameter 2, channel_shared bool 3
FlipParameter: flip_width bool 1, flip_height bool 2
InnerDistanceParameter: num_output uint32 1, bias_term bool 2, weight_filler FillerParameter 3,
  bias_filler FillerParameter 4, axis int32 5, transpose bool 6, distance_type string 7, normalize bool 8,
  update_center_only bool 9
ProposalParameter: feat_stride uint32 1, base_size uint32 2, min_size uint32 3, ratio float* 4, scale float* 5,
  pre_nms_topn uint32 6, post_nms_topn uint32 7, nms_thresh float 8
LargeMarginInnerProductParameter: num_output uint32 1, type LargeMarginType 2, weight_filler FillerParameter 3,
  axis int32 4, base float 5, gamma float 6, power float 7, iteration int32 8, lambda_min float 9
MarginInnerProductParameter: num_output uint32 1, type MarginType 2, weight_filler FillerParameter 3, axis int32 4,
  base float 5, gamma float 6, power float 7, iteration int32 8, lambda_min float 9
FocalLossParameter: type Type 1, gamma float 2, alpha float 3, beta float 4
LabelSpecificMarginParameter: type MarginType 9, margin_base float 1, margin_max float 2, power float 3, gamma float 4,
  iteration int32 5, reset_margin bool 6, margin_on_test bool 7, auto_tune bool 8
LabelSpecificAddParameter: bias float 1, transform_test bool 2, bias_base float 3, bias_gamma float 4,
  bias_power float 5, bias_min float 6, bias_max float 7, iteration uint32 8
NormalizedBBox: xmin float 1, ymin float 2, xmax float 3, ymax float 4, label int32 5, difficult bool 6, score float 7,
  size float 8
AnnotationGroup: group_label int32 1, annotation Annotation* 2
AnnotatedDatum: datum Datum 1, type AnnotationType 2, annotation_group AnnotationGroup* 3, record_id uint32 4
TransformationParameter: crop_h uint32 11/211/8, crop_w uint32 12/212/9, resize_param ResizeParameter 8/208,
  noise_param NoiseParameter 9/209, distort_param DistortionParameter 13/213, expand_param ExpansionParameter 14/214,
  emit_constraint EmitConstraint 10/210, enable_classf_aug bool 15, min_scaling_factor float 16,
  max_scaling_factor float 17, max_rotation_angle uint32 18, contrast_brightness_adjustment bool 19,
  smooth_filtering bool 20, min_contrast float 21, max_contrast float 22, max_brightness_shift uint32 23,
  max_smooth float 24, max_color_shift uint32 25, min_side_min uint32 26, min_side_max uint32 27, min_side uint32 28,
  apply_probability float 29, debug_params bool 30, cvt_bgr2rgb bool 31, img_rand_resize_lower uint32 10,
  img_rand_resize_upper uint32 11, rand_resize_ratio_lower float 12, rand_resize_ratio_upper float 13,
  vertical_stretch_lower float 14, vertical_stretch_upper float 15, horizontal_stretch_lower float 16,
  horizontal_stretch_upper float 17, interpolation_algo_down InterpolationAlgo 18,
  interpolation_algo_up InterpolationAlgo 19, allow_upscale bool 20, forward_packing Packing 21,
  use_gpu_transform bool 8, random_seed int64 9, display bool 22, num_labels int32 23, scale_factors float* 8,
  crop_width uint32 9, crop_height uint32 10, flow bool 6/17, fix_crop bool 10, more_fix_crop bool 15,
  multi_scale bool 11, scale_ratios float* 12, max_distort int32 13, is_flow bool 14, original_image bool 20,
  stride int32 16, upper_size int32 17, upper_height int32 18, upper_width int32 19,
  random_resize_param RandomResizeParameter 15, random_aspect_ratio_param RandomAspectRatioParameter 16,
  bgr2rgb bool 18, pad uint32 19
RandomResizeParameter: min_size uint32 1, max_size uint32 2, resize_param ResizeParameter 3
RandomAspectRatioParameter: min_area_ratio float 1, max_area_ratio float 2, aspect_ratio_change float 3,
  max_attempt uint32 4, resize_param ResizeParameter 5
LossParameter: label_smoothing float 4/5, weight_by_label_freqs bool 3, class_weighting float* 4,
  pre_fixed_normalizer float 4
AccuracyParameter: denominator float 4
BatchNormParameter: scale_filler FillerParameter 5/7, bias_filler FillerParameter 6/8, scale_bias bool 7,
  engine Engine 15/4, update_global_stats bool 4, use_weight_bias bool 5, bias_term bool 6, filler FillerParameter 7,
  stats_batch_size uint32 9, relu bool 10
ConcatParameter: per_fla_fuse bool 4, engine Engine 3
ConvolutionParameter: tf_pad TFPaddingMethod 19, cudnn_convolution_algo_seeker CuDNNConvolutionAlgorithmSeeker 19,
  conv_algos_override string 20, dilation_h uint32 17, dilation_w uint32 18, binary int32 19, relu bool 19,
  negative_slope float 20, conv_algorithm string 21, coeff float* 23, fusion_type FusionType 24
DataParameter: threads uint32 11, parser_threads uint32 12, shuffle bool 14/10/11, precache bool 16,
  disk_reader_threads uint32 4001, huge_video_dataset bool 7000, limit_samples int32 7001,
  preselection_file string 3001, preselection_label int32 3002, range_start int32 3003, range_end int32 3004,
  rand_permute bool 3005, rand_permute_order RANDPERMORDER 3006, rand_permute_seed uint32 3007,
  slice_point uint32* 3008, encoding CHANNELENCODING* 3009, verbose bool 3010, subtract float* 3011,
  permute_every_iter uint32 3012, block_size uint32 3013, side uint32* 12
DropoutParameter: engine Engine 2, random_seed int64 3
EltwiseParameter: coeff_blob bool 4, engine Engine 4
ELUParameter: lambda float 2
ImageDataParameter: short_side uint32 13, threads uint32 14, cache bool 15, precache bool 16,
  dataset_share_per_node float 17, label_divide_factor uint32 13, ignore_label int32 15, label_type LabelType 16,
  min_height uint32 13, min_width uint32 14
InnerProductParameter: engine Engine 7, relu bool 8, negative_slope float 9
PoolingParameter: torch_pooling bool 40, pad_3d uint32* 15, kernel_size_3d uint32* 16, stride_3d uint32* 17,
  avg_include_pad bool 13, axis int32 14
ReLUParameter: fuse bool 3
ReshapeParameter: pixelshuffler int32 4
PriorBoxParameter: reduce_boxes bool 14
ROIPoolingParameter: pooled_size uint32* 4
ReLU6Parameter: engine Engine 2
Annotation: instance_id int32 1, bbox NormalizedBBox 2, lanes LaneInfo 3
LaneInfo: x float 1, y float 2, id int32 3
"""

# Enum: values and their numbers
ENUMS = """
AnnotatedDatum.AnnotationType: BBOX 0
MultiBoxLossParameter.LocLossType: L2 0, SMOOTH_L1 1
MultiBoxLossParameter.ConfLossType: SOFTMAX 0, LOGISTIC 1
MultiBoxLossParameter.MatchType: BIPARTITE 0, PER_PREDICTION 1
MultiBoxLossParameter.MiningType: NONE 0, MAX_NEGATIVE 1, HARD_EXAMPLE 2
VideoDataParameter.VideoType: WEBCAM 0, VIDEO 1
VideoDataParameter.Modality: RGB 0, FLOW 1
Yolov3Parameter.IOU_LOSS: IOU 0, GIOU 1, MSE 2, DIOU 3, CIOU 4
TRTParameter.TRTMode: FP32 0, FP16 1, INT8 2
DetectNetGroundTruthParameter.GridboxType: GRIDBOX_MAX 0, GRIDBOX_MIN 1
DetectNetGroundTruthParameter.CoverageType: RECTANGULAR 0
EmitConstraint.EmitType: CENTER 0, MIN_OVERLAP 1
BiasChannelParameter.LabelType: IMAGE 1, PIXEL 2
SegAccuracyParameter.AccuracyMetric: PixelAccuracy 0, ClassAccuracy 1, PixelIOU 2
MultiStageMeanfieldParameter.Mode: POTTS 0
CorrelationParameter.CorrelationType: MULTIPLY 0, SUBTRACT 1
MeanParameter.MeanOperation: ADD 1, SUBTRACT 4
ResampleParameter.ResampleType: NEAREST 1, LINEAR 2, CUBIC 3, AREA 4
FlowWarpParameter.FillParameter: ZERO 1, NOT_A_NUMBER 2
QuantizationParameter.Precision: DYNAMIC_FIXED_POINT 0
QuantizationParameter.Rounding: NEAREST 0
EvalDetectionParameter.ScoreType: OBJ 0, PROB 1, MULTIPLY 2
LargeMarginInnerProductParameter.LargeMarginType: SINGLE 0, DOUBLE 1, TRIPLE 2, QUADRUPLE 3
MarginInnerProductParameter.MarginType: SINGLE 0, DOUBLE 1, TRIPLE 2, QUADRUPLE 3
FocalLossParameter.Type: ORIGIN 0, LINEAR 1, ONEADDP 2
LabelSpecificMarginParameter.MarginType: HARD 0, SOFT 1
TransformationParameter.InterpolationAlgo: INTER_NEAREST 0, INTER_LINEAR 1, INTER_CUBIC 2, INTER_AREA 3
Packing: NCHW 0, NHWC 1
BatchNormParameter.Engine: DEFAULT 0, CAFFE 1, CUDNN 2, MKL2017 3, MKLDNN 4
ConcatParameter.Engine: DEFAULT 0, CAFFE 1, MKL2017 3, MKLDNN 4
ConvolutionParameter.TFPaddingMethod: SAME 0, VALID 1
ConvolutionParameter.CuDNNConvolutionAlgorithmSeeker: GET 0, FINDEX 1
ConvolutionParameter.FusionType: NONE_FUSION 0, SUM_FUSION 1
DataParameter.RANDPERMORDER: FIRST_PERMUTE_THEN_RANGE 0, FIRST_RANGE_THEN_PERMUTE 1
DataParameter.CHANNELENCODING: UINT8 1, UINT16FLOW 2, BOOL1 3
DropoutParameter.Engine: DEFAULT 0, CAFFE 1, CUDNN 2
EltwiseParameter.Engine: DEFAULT 0, CAFFE 1, MKL2017 3, MKLDNN 4
ImageDataParameter.LabelType: NONE 0, IMAGE 1, PIXEL 2
InnerProductParameter.Engine: DEFAULT 0, CAFFE 1, CUDNN 2, MKLDNN 3
ReLU6Parameter.Engine: DEFAULT 0, CAFFE 1, CUDNN 2
"""


def add_to(file: Any) -> None:
    """Add the fields, messages and enums to a FileDescriptorProto."""
    messages = {message.name: message for message in file.message_type}
    for name, _ in _entries(MESSAGES):
        if name not in messages:
            owner, _, own = name.rpartition(".")
            added = messages[owner].nested_type if owner else file.message_type
            messages[name] = added.add(name=own)
    for name, values in _entries(ENUMS):
        owner, _, own = name.rpartition(".")
        enum = (messages[owner] if owner else file).enum_type.add(name=own)
        for value, number in values:
            enum.value.add(name=value, number=int(number))
    for name, fields in _entries(MESSAGES):
        for field in fields:
            _add_field(messages[name], *field)


def _entries(table: str) -> Iterator[tuple[str, list[list[str]]]]:
    """Name and items, as lists of words, of each line of a table; a line that begins with a
    space continues.
    """
    for line in table.replace("\n  ", " ").strip().split("\n"):
        name, _, items = line.partition(": ")
        yield name, [item.split() for item in items.split(", ")]


def _add_field(message: Any, name: str, kind: str, numbers: str) -> None:
    """Add a field with the first of its numbers that is free."""
    taken = {field.number for field in message.field}
    free = [number for number in map(int, numbers.split("/")) if number not in taken]
    number = free[0] if free else max(FIRST_FREE - 1, *taken) + 1
    field = message.field.add(name=name, number=number)
    field.label = field.LABEL_REPEATED if kind.endswith("*") else field.LABEL_OPTIONAL
    kind = kind.removesuffix("*")
    scalar = getattr(field, f"TYPE_{kind.upper()}", None)
    if scalar is None:
        field.type_name = kind  # protobuf looks it up in the message, then in the file
    else:
        field.type = scalar
