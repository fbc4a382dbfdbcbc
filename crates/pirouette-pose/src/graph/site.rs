//! Operator in a file, its options, and errors that name it

use crate::ModelError;
use crate::kernels::{Activation, Shape};
use crate::tflite::Operator;

/// Operator with its number, for errors
#[derive(Clone, Copy)]
pub(super) struct Site<'a> {
    pub(super) index: usize,
    pub(super) operator: &'a Operator<'a>,
}

impl Site<'_> {
    pub(super) fn unsupported(
        self,
        what: &'static str,
        found: i64,
        expected: &'static str,
    ) -> ModelError {
        ModelError::UnsupportedOption {
            operator: self.index,
            what,
            found,
            expected,
        }
    }

    pub(super) fn wrong_shape(
        self,
        what: &'static str,
        found: &[usize],
        expected: &[usize],
    ) -> ModelError {
        ModelError::WrongShape {
            operator: self.index,
            what,
            found: found.to_vec(),
            expected: expected.to_vec(),
        }
    }

    /// Reads the number of an input, -1 if there is none.
    pub(super) fn input(self, which: usize) -> i32 {
        self.operator.inputs.get(which).copied().unwrap_or(-1)
    }

    /// Reads an activation from a byte of the options.
    pub(super) fn activation(self, slot: usize) -> Result<Activation, ModelError> {
        match self.operator.byte(slot)? {
            0 => Ok(Activation::NONE),
            1 => Ok(Activation::RELU),
            3 => Ok(Activation::RELU6),
            other => Err(self.unsupported(
                "activation",
                other.into(),
                "0 (none), 1 (ReLU) or 3 (ReLU6)",
            )),
        }
    }

    /// Returns an error unless an option is 1.
    pub(super) fn require_one(self, what: &'static str, slot: usize) -> Result<(), ModelError> {
        match self.operator.int(slot, 1)? {
            1 => Ok(()),
            other => Err(self.unsupported(what, other.into(), "1")),
        }
    }
}

/// Interprets sizes of dimensions as an image; a vector is an image of one pixel.
pub(super) fn image(sizes: &[usize]) -> Option<Shape> {
    let shape = match *sizes {
        [1, height, width, channels] => Shape {
            height,
            width,
            channels,
        },
        [1, channels] => Shape {
            height: 1,
            width: 1,
            channels,
        },
        _ => return None,
    };
    (shape.len() > 0).then_some(shape)
}
