"""The messages of SSD's fork of Caffe that only its scripts use: labels, annotations, and options of training layers.

Nets do not read them: the training layers of SSD are not supported. A message is a text of its enums and fields, as
``type name number``, with ``repeated`` before a field and the default in brackets after it. The fields of
``ADDITIONS`` belong to messages that nets read, too.
"""

from __future__ import annotations

from typing import Any, NamedTuple

MESSAGES = {
    "LabelMapItem": "string name 1; int32 label 2; string display_name 3",
    "LabelMap": "repeated LabelMapItem item 1",
    "NormalizedBBox": "float xmin 1; float ymin 2; float xmax 3; float ymax 4; int32 label 5; bool difficult 6; "
                      "float score 7; float size 8",
    "Annotation": "int32 instance_id 1 [0]; NormalizedBBox bbox 2",
    "AnnotationGroup": "int32 group_label 1; repeated Annotation annotation 2",
    "AnnotatedDatum": "enum AnnotationType BBOX; Datum datum 1; AnnotationType type 2; "
                      "repeated AnnotationGroup annotation_group 3",
    "Sampler": "float min_scale 1 [1]; float max_scale 2 [1]; float min_aspect_ratio 3 [1]; "
               "float max_aspect_ratio 4 [1]",
    "SampleConstraint": "float min_jaccard_overlap 1; float max_jaccard_overlap 2; float min_sample_coverage 3; "
                        "float max_sample_coverage 4; float min_object_coverage 5; float max_object_coverage 6",
    "BatchSampler": "bool use_original_image 1 [true]; Sampler sampler 2; SampleConstraint sample_constraint 3; "
                    "uint32 max_sample 4; uint32 max_trials 5 [100]",
    "EmitConstraint": "enum EmitType CENTER MIN_OVERLAP; EmitType emit_type 1 [CENTER]; float emit_overlap 2",
    "SaltPepperParameter": "float fraction 1 [0]; repeated float value 2",
    "NoiseParameter": "float prob 1 [0]; bool hist_eq 2 [false]; bool inverse 3 [false]; bool decolorize 4 [false]; "
                      "bool gauss_blur 5 [false]; float jpeg 6 [-1]; bool posterize 7 [false]; bool erode 8 [false]; "
                      "bool saltpepper 9 [false]; SaltPepperParameter saltpepper_param 10; bool clahe 11 [false]; "
                      "bool convert_to_hsv 12 [false]; bool convert_to_lab 13 [false]",
    "DistortionParameter": "float brightness_prob 1 [0]; float brightness_delta 2 [0]; float contrast_prob 3 [0]; "
                           "float contrast_lower 4 [0]; float contrast_upper 5 [0]; float hue_prob 6 [0]; "
                           "float hue_delta 7 [0]; float saturation_prob 8 [0]; float saturation_lower 9 [0]; "
                           "float saturation_upper 10 [0]; float random_order_prob 11 [0]",
    "ExpansionParameter": "float prob 1 [1]; float max_expand_ratio 2 [1]",
    "AnnotatedDataParameter": "repeated BatchSampler batch_sampler 1; string label_map_file 2; "
                              "AnnotatedDatum.AnnotationType anno_type 3",
    "MultiBoxLossParameter": "enum LocLossType L2 SMOOTH_L1; enum ConfLossType SOFTMAX LOGISTIC; "
                             "enum MatchType BIPARTITE PER_PREDICTION; enum MiningType NONE MAX_NEGATIVE HARD_EXAMPLE; "
                             "LocLossType loc_loss_type 1 [SMOOTH_L1]; ConfLossType conf_loss_type 2 [SOFTMAX]; "
                             "float loc_weight 3 [1]; uint32 num_classes 4; bool share_location 5 [true]; "
                             "MatchType match_type 6 [PER_PREDICTION]; float overlap_threshold 7 [0.5]; "
                             "bool use_prior_for_matching 8 [true]; uint32 background_label_id 9 [0]; "
                             "bool use_difficult_gt 10 [true]; bool do_neg_mining 11; float neg_pos_ratio 12 [3]; "
                             "float neg_overlap 13 [0.5]; PriorBoxParameter.CodeType code_type 14 [CORNER]; "
                             "bool encode_variance_in_target 16 [false]; bool map_object_to_agnostic 17 [false]; "
                             "bool ignore_cross_boundary_bbox 18 [false]; bool bp_inside 19 [false]; "
                             "MiningType mining_type 20 [MAX_NEGATIVE]; NonMaximumSuppressionParameter nms_param 21; "
                             "int32 sample_size 22 [64]; bool use_prior_for_nms 23 [false]",
    "DetectionEvaluateParameter": "uint32 num_classes 1; uint32 background_label_id 2 [0]; "
                                  "float overlap_threshold 3 [0.5]; bool evaluate_difficult_gt 4 [true]; "
                                  "string name_size_file 5; ResizeParameter resize_param 6",
    "VideoDataParameter": "enum VideoType WEBCAM VIDEO; VideoType video_type 1 [WEBCAM]; int32 device_id 2 [0]; "
                          "string video_file 3; uint32 skip_frames 4 [0]",
}
ADDITIONS = {
    "LayerParameter": "AnnotatedDataParameter annotated_data_param 200; "
                      "MultiBoxLossParameter multibox_loss_param 201; "
                      "DetectionEvaluateParameter detection_evaluate_param 205; "
                      "VideoDataParameter video_data_param 207",
    "TransformationParameter": "ResizeParameter resize_param 8; NoiseParameter noise_param 9; "
                               "EmitConstraint emit_constraint 10; uint32 crop_h 11 [0]; uint32 crop_w 12 [0]; "
                               "DistortionParameter distort_param 13; ExpansionParameter expand_param 14",
    # Solvers are texts, so other numbers than the fork's do not matter; 41 and 42 are later fields of Caffe.
    "SolverParameter": "string eval_type 1041 [classification]; string ap_version 1042 [Integral]; "
                       "repeated int32 plateau_winsize 1043; bool show_per_class_result 1044 [false]",
}
SCALARS = ("bool", "float", "int32", "string", "uint32")


class Field(NamedTuple):
    """A field; ``kind`` is a scalar type or the name of a message or enum, ``default`` is empty without one."""

    kind: str
    name: str
    number: int
    is_repeated: bool
    default: str


def parsed(text: str) -> tuple[dict[str, list[str]], list[Field]]:
    """The enums of a message, with their values in order, and its fields."""
    enums: dict[str, list[str]] = {}
    fields: list[Field] = []
    for part in text.split("; "):
        words = part.split()
        if words[0] == "enum":
            enums[words[1]] = words[2:]
            continue
        repeated = words[0] == "repeated"
        kind, name, number, *default = words[repeated:]
        fields.append(Field(kind, name, int(number), repeated, default[0].strip("[]") if default else ""))
    return enums, fields


def describe(file: Any) -> None:
    """Add the messages and fields to a FileDescriptorProto that has those of the nets."""
    known = {message.name: message for message in file.message_type}
    for name in MESSAGES:
        known[name] = file.message_type.add(name=name)
    for name, text in (MESSAGES | ADDITIONS).items():
        enums, fields = parsed(text)
        for enum, values in enums.items():
            described = known[name].enum_type.add(name=enum)
            for number, value in enumerate(values):
                described.value.add(name=value, number=number)
        present = {field.name for field in known[name].field}
        for field in fields:
            if field.name not in present:
                _describe_field(file.package, name, known, field)


def _describe_field(package: str, owner: str, known: dict[str, Any], field: Field) -> None:
    added = known[owner].field.add(name=field.name, number=field.number)
    added.label = added.LABEL_REPEATED if field.is_repeated else added.LABEL_OPTIONAL
    if field.kind in SCALARS:
        added.type = getattr(added, f"TYPE_{field.kind.upper()}")
    else:
        is_message = field.kind in known
        path = field.kind if is_message or "." in field.kind else f"{owner}.{field.kind}"
        added.type = added.TYPE_MESSAGE if is_message else added.TYPE_ENUM
        added.type_name = f".{package}.{path}"
    if field.default:
        added.default_value = field.default
