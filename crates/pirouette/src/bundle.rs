//! One skeleton for all views: camera distance, bone lengths and the pose of each view from keypoints.
