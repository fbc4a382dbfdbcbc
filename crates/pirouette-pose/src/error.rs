//! Why a model is rejected

use thiserror::Error;

/// Reason why [`PoseModel::parse`](crate::PoseModel::parse) rejects a file
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The file is not a TFLite model
    #[error(
        "not a TFLite model: the file identifier \"TFL3\" is missing; expected a file pose_landmark_*.tflite of MediaPipe"
    )]
    NotTflite,
    /// An offset or a length in the file points outside the file
    #[error(
        "damaged model: an offset or length at byte {offset} points outside the file; fetch the file again"
    )]
    Damaged {
        /// Place of the value in the file, in bytes
        offset: usize,
    },
    /// A quantity exceeds the limit up to which models are accepted
    #[error(
        "model too large: {what} {found}, at most {limit}; expected a file pose_landmark_*.tflite of MediaPipe"
    )]
    TooLarge {
        /// The quantity
        what: &'static str,
        /// Its value in the file
        found: usize,
        /// Largest accepted value
        limit: usize,
    },
    /// The network contains an operator that is not implemented
    #[error(
        "operator {operator} of the model has TFLite code {code}, which is not supported; expected a pose landmark model with floating-point weights"
    )]
    UnsupportedOperator {
        /// Number of the operator in the file
        operator: usize,
        /// Its built-in operator code in the TFLite schema
        code: i32,
    },
    /// An operator has an option or a shape that is not supported
    #[error(
        "operator {operator} of the model: {what} {found} is not supported, expected {expected}"
    )]
    UnsupportedOption {
        /// Number of the operator in the file
        operator: usize,
        /// The option
        what: &'static str,
        /// Its value in the file
        found: i64,
        /// Supported values
        expected: &'static str,
    },
    /// The shapes of an operator and its tensors do not match
    #[error(
        "operator {operator} of the model: {what} must have shape {expected:?} (0: any size), found {found:?}"
    )]
    WrongShape {
        /// Number of the operator in the file
        operator: usize,
        /// The tensor
        what: &'static str,
        /// Its shape in the file
        found: Vec<usize>,
        /// The shape that the operator requires, 0 where any size is accepted
        expected: Vec<usize>,
    },
    /// An operator reads a tensor that is neither a constant of the required type nor computed before
    #[error(
        "operator {operator} of the model: {what} (tensor {tensor}) is missing or has an unsupported type"
    )]
    MissingTensor {
        /// Number of the operator in the file
        operator: usize,
        /// Role of the tensor
        what: &'static str,
        /// Number of the tensor in the file, -1 if the operator does not name one
        tensor: i32,
    },
    /// An input or output of the network is not that of a pose landmark model
    #[error("not a pose landmark model: {what} has shape {found:?}, expected {expected}")]
    WrongInterface {
        /// The input or output
        what: &'static str,
        /// Its shape in the file; empty if it is missing
        found: Vec<usize>,
        /// The expected shape
        expected: &'static str,
    },
}
