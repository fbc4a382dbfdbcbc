//! A pose landmark model of a few kilobytes, with all supported operators

pub(crate) mod flatbuffer;

use flatbuffer::{Table, Value, write};

/// Built-in operators, and their places in the list of the file
const CODES: [i32; 9] = [34, 3, 4, 0, 23, 17, 22, 14, 6];
const PAD: i32 = 0;
const CONV: i32 = 1;
const DEPTHWISE: i32 = 2;
const ADD: i32 = 3;
const RESIZE: i32 = 4;
const MAX_POOL: i32 = 5;
const RESHAPE: i32 = 6;
const LOGISTIC: i32 = 7;
const DEQUANTIZE: i32 = 8;

/// Graph under construction
#[derive(Default)]
pub(crate) struct Builder {
    pub(crate) buffers: Vec<Vec<u8>>,
    pub(crate) tensors: Vec<Table>,
    pub(crate) operators: Vec<Table>,
}

impl Builder {
    /// Adds a tensor; `buffer` 0 is empty.
    pub(crate) fn tensor(&mut self, shape: &[i32], kind: u8, buffer: i32) -> i32 {
        self.tensors.push(vec![
            (0, Value::Ints(shape.to_vec())),
            (1, Value::Byte(kind)),
            (2, Value::Int(buffer)),
        ]);
        self.tensors.len() as i32 - 1
    }

    fn constant(&mut self, shape: &[i32], kind: u8, data: Vec<u8>) -> i32 {
        self.buffers.push(data);
        self.tensor(shape, kind, self.buffers.len() as i32 - 1)
    }

    pub(crate) fn ints(&mut self, shape: &[i32], values: &[i32]) -> i32 {
        self.constant(
            shape,
            2,
            values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        )
    }

    /// Adds a constant of half-precision numbers, 0.25 and -0.25, and its conversion.
    pub(crate) fn halves(&mut self, shape: &[i32]) -> i32 {
        let len: i32 = shape.iter().product();
        let half = |i: i32| if i * 7 % 5 < 2 { 0x3400u16 } else { 0xb400 };
        let stored = self.constant(
            shape,
            1,
            (0..len).flat_map(|i| half(i).to_le_bytes()).collect(),
        );
        self.operator(DEQUANTIZE, &[stored], shape, vec![])
    }

    pub(crate) fn operator(
        &mut self,
        code: i32,
        inputs: &[i32],
        shape: &[i32],
        options: Table,
    ) -> i32 {
        let output = self.tensor(shape, 0, 0);
        self.operators.push(vec![
            (0, Value::Int(code)),
            (1, Value::Ints(inputs.to_vec())),
            (2, Value::Ints(vec![output])),
            (4, Value::Table(options)),
        ]);
        output
    }

    pub(crate) fn convolution(
        &mut self,
        input: i32,
        weights: &[i32; 4],
        shape: &[i32],
        valid: u8,
        stride: i32,
    ) -> i32 {
        let inputs = [input, self.halves(weights), self.halves(&weights[..1])];
        let options = vec![
            (0, Value::Byte(valid)),
            (1, Value::Int(stride)),
            (2, Value::Int(stride)),
            (3, Value::Byte(3)),
        ];
        self.operator(CONV, &inputs, shape, options)
    }

    /// Writes the file.
    pub(crate) fn write(&self, inputs: &[i32], outputs: &[i32]) -> Vec<u8> {
        let graph = vec![
            (0, Value::Tables(self.tensors.clone())),
            (1, Value::Ints(inputs.to_vec())),
            (2, Value::Ints(outputs.to_vec())),
            (3, Value::Tables(self.operators.clone())),
        ];
        let code = |&code: &i32| vec![(0, Value::Byte(code as u8)), (3, Value::Int(code))];
        let buffer = |data: &Vec<u8>| vec![(0, Value::Bytes(data.clone()))];
        let root = vec![
            (0, Value::Int(3)),
            (1, Value::Tables(CODES.iter().map(code).collect())),
            (2, Value::Tables(vec![graph])),
            (4, Value::Tables(self.buffers.iter().map(buffer).collect())),
        ];
        write(&root, *b"TFL3")
    }
}

/// Writes the model: input of 8 x 8 px, heat maps and mask of 4 x 4 cells. Weights are at the end.
pub(crate) fn tiny_model() -> Vec<u8> {
    let mut b = Builder {
        buffers: vec![vec![]],
        ..Builder::default()
    };
    let image = [1, 4, 4, 2];
    let input = b.tensor(&[1, 8, 8, 3], 0, 0);
    let pads = b.ints(&[4, 2], &[0, 0, 0, 1, 0, 1, 0, 0]);
    let padded = b.operator(PAD, &[input, pads], &[1, 9, 9, 3], vec![]);
    let first = b.convolution(padded, &[2, 3, 3, 3], &image, 1, 2);
    let expanded = b.convolution(first, &[20, 1, 1, 2], &[1, 4, 4, 20], 0, 1);
    let inputs = [expanded, b.halves(&[1, 3, 3, 20]), b.halves(&[20])];
    let options = vec![
        (1, Value::Int(1)),
        (2, Value::Int(1)),
        (3, Value::Int(1)),
        (4, Value::Byte(1)),
    ];
    let depthwise = b.operator(DEPTHWISE, &inputs, &[1, 4, 4, 20], options);
    let projected = b.convolution(depthwise, &[2, 1, 1, 20], &image, 0, 1);
    let pooled = (0..6)
        .map(|slot| {
            (
                slot,
                if slot % 5 == 0 {
                    Value::Byte(0)
                } else {
                    Value::Int(2)
                },
            )
        })
        .collect();
    let pooled = b.operator(MAX_POOL, &[projected], &[1, 2, 2, 2], pooled);
    let size = b.ints(&[2], &[4, 4]);
    let resized = b.operator(RESIZE, &[pooled, size], &image, vec![(3, Value::Byte(1))]);
    let sum = b.operator(ADD, &[resized, first], &image, vec![]);
    let heat = b.convolution(sum, &[39, 1, 1, 2], &[1, 4, 4, 39], 0, 1);
    let mask = b.convolution(sum, &[1, 1, 1, 2], &[1, 4, 4, 1], 0, 1);
    let small = b.convolution(sum, &[2, 3, 3, 2], &[1, 1, 1, 2], 1, 2);
    let landmarks = b.convolution(small, &[195, 1, 1, 2], &[1, 1, 1, 195], 0, 1);
    let presence = b.convolution(small, &[1, 1, 1, 2], &[1, 1, 1, 1], 0, 1);
    let landmarks = b.operator(RESHAPE, &[landmarks], &[1, 195], vec![]);
    let presence = b.operator(LOGISTIC, &[presence], &[1, 1, 1, 1], vec![]);
    let presence = b.operator(RESHAPE, &[presence], &[1, 1], vec![]);
    b.write(&[input], &[landmarks, presence, mask, heat])
}
