//! The parts of the TFLite schema that pose networks use
//!
//! # Source
//! TensorFlow Lite, `tensorflow/compiler/mlir/lite/schema/schema.fbs`, version 3

use crate::ModelError;
use crate::flatbuffer::{Table, check_limit};
use crate::half::f32_from_half;

/// Largest accepted numbers of items; the largest known pose network has about 1100 tensors and 580 operators
const MAX_TENSORS: usize = 8192;
const MAX_OPERATORS: usize = 8192;
const MAX_OPERATOR_CODES: usize = 256;
const MAX_RANK: usize = 4;
const MAX_OPERANDS: usize = 8;

/// Largest accepted number of elements of a tensor; 16 times that of the largest known pose network
const MAX_ELEMENTS: usize = 1 << 24;

/// Codes of element types in the schema
const FLOAT32: u8 = 0;
const FLOAT16: u8 = 1;
const INT32: u8 = 2;

/// Codes of built-in operators in the schema
pub(crate) mod code {
    pub(crate) const ADD: i32 = 0;
    pub(crate) const CONV_2D: i32 = 3;
    pub(crate) const DEPTHWISE_CONV_2D: i32 = 4;
    pub(crate) const DEQUANTIZE: i32 = 6;
    pub(crate) const LOGISTIC: i32 = 14;
    pub(crate) const MAX_POOL_2D: i32 = 17;
    pub(crate) const RESHAPE: i32 = 22;
    pub(crate) const RESIZE_BILINEAR: i32 = 23;
    pub(crate) const PAD: i32 = 34;
}

/// Tensor as stored: its data is empty unless it is a constant
#[derive(Debug)]
pub(crate) struct Tensor<'a> {
    /// Sizes of the dimensions; the product of those above 1 is at most [`MAX_ELEMENTS`]
    pub(crate) shape: Vec<usize>,
    kind: u8,
    sparse: bool,
    data: &'a [u8],
}

/// Operator as stored
#[derive(Debug)]
pub(crate) struct Operator<'a> {
    pub(crate) code: i32,
    pub(crate) inputs: Vec<i32>,
    pub(crate) outputs: Vec<i32>,
    options: Option<Table<'a>>,
}

/// First graph of a file
#[derive(Debug)]
pub(crate) struct File<'a> {
    pub(crate) tensors: Vec<Tensor<'a>>,
    pub(crate) operators: Vec<Operator<'a>>,
    pub(crate) inputs: Vec<i32>,
    pub(crate) outputs: Vec<i32>,
}

impl<'a> File<'a> {
    /// Reads the tables of a file; the data of tensors is not copied.
    pub(crate) fn read(bytes: &'a [u8]) -> Result<Self, ModelError> {
        if bytes.get(4..8) != Some(b"TFL3") {
            return Err(ModelError::NotTflite);
        }
        let root = Table::root(bytes)?;
        let codes = root.tables(1, "number of operator codes", MAX_OPERATOR_CODES)?;
        let codes = codes
            .iter()
            .map(operator_code)
            .collect::<Result<Vec<_>, _>>()?;
        let graphs = root.tables(2, "number of graphs", 1)?;
        let graph = graphs.first().ok_or(ModelError::NotTflite)?;
        let buffers = root.tables(4, "number of buffers", MAX_TENSORS)?;
        let tensors = graph.tables(0, "number of tensors", MAX_TENSORS)?;
        let operators = graph.tables(3, "number of operators", MAX_OPERATORS)?;
        Ok(Self {
            tensors: tensors
                .iter()
                .map(|t| Tensor::read(t, &buffers))
                .collect::<Result<_, _>>()?,
            operators: operators
                .iter()
                .enumerate()
                .map(|(i, t)| Operator::read(i, t, &codes))
                .collect::<Result<_, _>>()?,
            inputs: graph.i32s(1, "number of inputs", MAX_OPERANDS)?,
            outputs: graph.i32s(2, "number of outputs", MAX_OPERANDS)?,
        })
    }

    /// Returns a tensor by its number in the file.
    pub(crate) fn tensor(&self, index: i32) -> Option<&Tensor<'a>> {
        self.tensors.get(usize::try_from(index).ok()?)
    }
}

/// Codes up to 127 are stored in an old field, of one byte.
fn operator_code(table: &Table) -> Result<i32, ModelError> {
    Ok(i32::from(table.u8(0, 0)?).max(table.i32(3, 0)?))
}

impl<'a> Tensor<'a> {
    fn read(table: &Table<'a>, buffers: &[Table<'a>]) -> Result<Self, ModelError> {
        let sizes = table.i32s(0, "number of dimensions of a tensor", MAX_RANK)?;
        let mut shape = Vec::with_capacity(sizes.len());
        let mut elements = 1usize;
        for size in sizes {
            let size = usize::try_from(size).unwrap_or(usize::MAX);
            elements = elements.saturating_mul(size.max(1));
            shape.push(size);
        }
        check_limit("number of elements of a tensor", elements, MAX_ELEMENTS)?;
        let buffer = usize::try_from(table.i32(2, 0)?)
            .ok()
            .and_then(|i| buffers.get(i));
        Ok(Self {
            shape,
            kind: table.u8(1, FLOAT32)?,
            sparse: table.table(6)?.is_some(),
            data: buffer.map_or(Ok(&[][..]), |b| b.bytes(0))?,
        })
    }

    /// Returns the number of elements of a constant, `None` if the stored data has another length.
    fn constant_len(&self, element_len: usize) -> Option<usize> {
        let elements = self.shape.iter().product::<usize>();
        (!self.sparse && elements > 0 && self.data.len() == elements * element_len)
            .then_some(elements)
    }

    /// Decodes a constant of floating-point numbers; `None` if the tensor is none.
    pub(crate) fn floats(&self) -> Option<Vec<f32>> {
        match self.kind {
            FLOAT32 => {
                self.constant_len(4)?;
                Some(
                    self.data
                        .as_chunks()
                        .0
                        .iter()
                        .map(|&b| f32::from_le_bytes(b))
                        .collect(),
                )
            }
            FLOAT16 => {
                self.constant_len(2)?;
                Some(
                    self.data
                        .as_chunks()
                        .0
                        .iter()
                        .map(|&b| f32_from_half(u16::from_le_bytes(b)))
                        .collect(),
                )
            }
            _ => None,
        }
    }

    /// Decodes a constant of at most `limit` integers; `None` if the tensor is none.
    pub(crate) fn integers(&self, limit: usize) -> Option<Vec<i32>> {
        (self.kind == INT32 && self.constant_len(4)? <= limit).then(|| {
            self.data
                .as_chunks()
                .0
                .iter()
                .map(|&b| i32::from_le_bytes(b))
                .collect()
        })
    }

    /// Tests whether computed values of the tensor are 32-bit floating-point numbers.
    pub(crate) fn is_f32(&self) -> bool {
        self.kind == FLOAT32
    }
}

impl<'a> Operator<'a> {
    fn read(index: usize, table: &Table<'a>, codes: &[i32]) -> Result<Self, ModelError> {
        let code = table.i32(0, 0)?;
        let code = usize::try_from(code).ok().and_then(|i| codes.get(i));
        Ok(Self {
            code: *code.ok_or(ModelError::UnsupportedOperator {
                operator: index,
                code: -1,
            })?,
            inputs: table.i32s(1, "number of inputs of an operator", MAX_OPERANDS)?,
            outputs: table.i32s(2, "number of outputs of an operator", MAX_OPERANDS)?,
            options: table.table(4)?,
        })
    }

    /// Reads an option of one byte.
    pub(crate) fn byte(&self, slot: usize) -> Result<u8, ModelError> {
        self.options.map_or(Ok(0), |t| t.u8(slot, 0))
    }

    /// Reads an option of 32 bits.
    pub(crate) fn int(&self, slot: usize, default: i32) -> Result<i32, ModelError> {
        self.options.map_or(Ok(default), |t| t.i32(slot, default))
    }
}
