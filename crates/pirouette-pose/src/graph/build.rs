//! Checks operators one after the other, and packs their weights

use super::site::{Site, image};
use super::{Graph, Kernel, Node};
use crate::ModelError;
use crate::flatbuffer::check_limit;
use crate::kernels::Shape;
use crate::kernels::convolution::Convolution;
use crate::kernels::depthwise::Depthwise;
use crate::kernels::elementwise::Pad;
use crate::kernels::pool::MaxPool;
use crate::kernels::resize::{Alignment, Resize};
use crate::kernels::single::SingleConvolution;
use crate::kernels::window::{Padding, Span, Window};
use crate::tflite::{File, Tensor, code};

/// Largest accepted number of packed weights; twice that of the largest known pose network
const MAX_WEIGHTS: usize = 1 << 25;
/// Output channels up to whose multiple weights are padded when they are packed
const PACKED_CHANNELS: usize = 16;
/// Largest accepted padding on one side, in pixels or channels
const MAX_PADDING: i32 = 4096;

/// What is known of a tensor while operators are read
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    /// As stored: a constant, or not computed yet
    Stored,
    /// Constant of another tensor
    Constant(i32),
    /// Computed value
    Value(usize),
}

pub(super) struct Builder<'a> {
    file: &'a File<'a>,
    contents: Vec<Content>,
    graph: Graph,
    /// Number of weights that may still be decoded; at most one per byte of the file
    weights_left: usize,
    packed_weights: usize,
}

/// Weights of a convolution, as stored
struct Weights {
    weights: Vec<f32>,
    bias: Vec<f32>,
    /// Sizes of the dimensions of the weights
    sizes: [usize; 4],
}

impl<'a> Builder<'a> {
    pub(super) fn new(file: &'a File<'a>, file_len: usize) -> Result<Self, ModelError> {
        let sizes = |t: Option<&Tensor>| t.map_or(Vec::new(), |t| t.shape.clone());
        let [input] = file.inputs[..] else {
            return Err(ModelError::WrongInterface {
                what: "the list of inputs",
                found: vec![file.inputs.len()],
                expected: "[1]",
            });
        };
        let tensor = file.tensor(input);
        let shape = tensor
            .filter(|t| t.is_f32())
            .and_then(|t| image(&t.shape))
            .ok_or_else(|| ModelError::WrongInterface {
                what: "the input",
                found: sizes(tensor),
                expected: "[1, height, width, channels] of f32",
            })?;
        let mut contents = vec![Content::Stored; file.tensors.len()];
        if let Some(content) = usize::try_from(input)
            .ok()
            .and_then(|i| contents.get_mut(i))
        {
            *content = Content::Value(0);
        }
        let graph = Graph {
            values: vec![shape],
            nodes: Vec::new(),
            outputs: Vec::new(),
        };
        Ok(Self {
            file,
            contents,
            graph,
            weights_left: file_len,
            packed_weights: 0,
        })
    }

    pub(super) fn build(mut self) -> Result<Graph, ModelError> {
        for (index, operator) in self.file.operators.iter().enumerate() {
            self.add_operator(Site { index, operator })?;
        }
        let find = |&tensor: &i32| match self.content(tensor) {
            Some(Content::Value(value)) => Ok(value),
            _ => Err(ModelError::WrongInterface {
                what: "an output",
                found: Vec::new(),
                expected: "a computed tensor",
            }),
        };
        let outputs = self
            .file
            .outputs
            .iter()
            .map(find)
            .collect::<Result<_, _>>()?;
        Ok(Graph {
            outputs,
            ..self.graph
        })
    }

    fn content(&self, tensor: i32) -> Option<Content> {
        self.contents.get(usize::try_from(tensor).ok()?).copied()
    }

    fn add_operator(&mut self, site: Site) -> Result<(), ModelError> {
        let kernel = match site.operator.code {
            code::DEQUANTIZE => return self.add_constant(site),
            code::RESHAPE => return self.add_alias(site),
            code::CONV_2D => return self.add_convolution(site),
            code::DEPTHWISE_CONV_2D => return self.add_depthwise(site),
            code::ADD => return self.add_sum(site),
            code::MAX_POOL_2D => self.max_pool(site)?,
            code::PAD => self.pad(site)?,
            code::RESIZE_BILINEAR => self.resize(site)?,
            code::LOGISTIC => Kernel::Logistic(self.value(site, 0)?.1),
            code => {
                return Err(ModelError::UnsupportedOperator {
                    operator: site.index,
                    code,
                });
            }
        };
        let input = self.value(site, 0)?.0;
        self.add_node(site, kernel, [input, input])
    }

    /// Returns the number and size of a computed input.
    fn value(&self, site: Site, which: usize) -> Result<(usize, Shape), ModelError> {
        match self.content(site.input(which)) {
            Some(Content::Value(value)) => Ok((value, self.graph.values[value])),
            _ => Err(ModelError::MissingTensor {
                operator: site.index,
                what: "a computed input",
                tensor: site.input(which),
            }),
        }
    }

    /// Returns the tensor of a constant input.
    fn constant(
        &self,
        site: Site,
        which: usize,
        what: &'static str,
    ) -> Result<&'a Tensor<'a>, ModelError> {
        let tensor = match self.content(site.input(which)) {
            Some(Content::Stored) => self.file.tensor(site.input(which)),
            Some(Content::Constant(source)) => self.file.tensor(source),
            _ => None,
        };
        tensor.ok_or(ModelError::MissingTensor {
            operator: site.index,
            what,
            tensor: site.input(which),
        })
    }

    /// Decodes a constant of floating-point numbers.
    fn floats(
        &mut self,
        site: Site,
        which: usize,
        what: &'static str,
    ) -> Result<Vec<f32>, ModelError> {
        let tensor = self.constant(site, which, what)?;
        let len = tensor.shape.iter().product();
        check_limit(
            "number of weights, beyond those in the file,",
            len,
            self.weights_left,
        )?;
        self.weights_left -= len;
        tensor.floats().ok_or(ModelError::MissingTensor {
            operator: site.index,
            what,
            tensor: site.input(which),
        })
    }

    /// Decodes a constant of `N` integers.
    fn integers<const N: usize>(
        &self,
        site: Site,
        which: usize,
        what: &'static str,
    ) -> Result<[i32; N], ModelError> {
        let values = self.constant(site, which, what)?.integers(N);
        values
            .and_then(|v| v.try_into().ok())
            .ok_or(ModelError::MissingTensor {
                operator: site.index,
                what,
                tensor: site.input(which),
            })
    }

    /// Sets what the only output of an operator contains.
    fn set_output(&mut self, site: Site, content: Content) -> Result<(), ModelError> {
        let tensor = site.operator.outputs.first().copied().unwrap_or(-1);
        let slot = usize::try_from(tensor)
            .ok()
            .and_then(|i| self.contents.get_mut(i));
        match slot {
            Some(slot) if *slot == Content::Stored && site.operator.outputs.len() == 1 => {
                *slot = content
            }
            _ => {
                return Err(ModelError::MissingTensor {
                    operator: site.index,
                    what: "a new output",
                    tensor,
                });
            }
        }
        Ok(())
    }

    /// Returns the size of the output in the file.
    fn declared(&self, site: Site) -> Result<Shape, ModelError> {
        let tensor = site.operator.outputs.first().copied().unwrap_or(-1);
        let found = self.file.tensor(tensor).filter(|t| t.is_f32());
        found
            .and_then(|t| image(&t.shape))
            .ok_or(ModelError::MissingTensor {
                operator: site.index,
                what: "an output image of f32",
                tensor,
            })
    }

    fn add_node(
        &mut self,
        site: Site,
        kernel: Kernel,
        inputs: [usize; 2],
    ) -> Result<(), ModelError> {
        let (shape, declared) = (kernel.result(), self.declared(site)?);
        if shape != declared {
            return Err(site.wrong_shape("the output", &declared.sizes(), &shape.sizes()));
        }
        let output = self.graph.values.len();
        self.set_output(site, Content::Value(output))?;
        self.graph.values.push(shape);
        self.graph.nodes.push(Node {
            kernel,
            inputs,
            output,
        });
        Ok(())
    }

    /// Conversion of a constant to another type: constants are converted when they are read.
    fn add_constant(&mut self, site: Site) -> Result<(), ModelError> {
        match self.content(site.input(0)) {
            Some(Content::Stored) => self.set_output(site, Content::Constant(site.input(0))),
            _ => Err(ModelError::MissingTensor {
                operator: site.index,
                what: "a constant",
                tensor: site.input(0),
            }),
        }
    }

    /// Change of shape: only between an image of one pixel and a vector, which are the same here.
    fn add_alias(&mut self, site: Site) -> Result<(), ModelError> {
        let (value, shape) = self.value(site, 0)?;
        let declared = self.declared(site)?;
        if declared != shape {
            return Err(site.wrong_shape("the output", &declared.sizes(), &shape.sizes()));
        }
        self.set_output(site, Content::Value(value))
    }

    fn add_sum(&mut self, site: Site) -> Result<(), ModelError> {
        let ((a, shape), (b, other)) = (self.value(site, 0)?, self.value(site, 1)?);
        if shape != other {
            return Err(site.wrong_shape("the second input", &other.sizes(), &shape.sizes()));
        }
        self.add_node(site, Kernel::Add(shape, site.activation(0)?), [a, b])
    }

    /// Places the windows of a convolution or a maximum; options 0 to 2 are the padding and the strides.
    fn window(
        &self,
        site: Site,
        size: Shape,
        kernel: [usize; 2],
        pads: [[usize; 2]; 2],
    ) -> Result<Window, ModelError> {
        let same = match site.operator.byte(0)? {
            0 => true,
            1 => false,
            other => {
                return Err(site.unsupported("padding", other.into(), "0 (same) or 1 (valid)"));
            }
        };
        let span = |size, kernel, slot, pads: [usize; 2], what| {
            let stride = site.operator.int(slot, 1)?;
            let padding = if same {
                Padding::Same
            } else {
                Padding::Explicit(pads[0], pads[1])
            };
            usize::try_from(stride)
                .ok()
                .and_then(|stride| Span::new(size, kernel, stride, padding))
                .ok_or(site.unsupported(
                    what,
                    stride.into(),
                    "1 to 8, with a window of 1 to 8 px that fits the image",
                ))
        };
        Ok(Window {
            rows: span(size.height, kernel[0], 2, pads[0], "vertical stride")?,
            columns: span(size.width, kernel[1], 1, pads[1], "horizontal stride")?,
        })
    }

    /// Returns the input of a convolution: with padding that a preceding operator adds, if it is the explicit kind.
    fn padded_input(&self, site: Site) -> Result<(usize, Shape, [[usize; 2]; 2]), ModelError> {
        let (value, shape) = self.value(site, 0)?;
        let is_valid = site.operator.byte(0)? == 1;
        let producer = self.graph.nodes.iter().rev().find(|n| n.output == value);
        if let (
            true,
            Some(Node {
                kernel: Kernel::Pad(pad),
                inputs,
                ..
            }),
        ) = (is_valid, producer)
            && pad.channels == [0, 0]
        {
            return Ok((inputs[0], pad.input, [pad.rows, pad.columns]));
        }
        Ok((value, shape, [[0; 2]; 2]))
    }

    /// Reads weights and biases, after checking the shape of the weights.
    fn weights(&mut self, site: Site, expected: [Option<usize>; 4]) -> Result<Weights, ModelError> {
        let shape = &self.constant(site, 1, "the weights")?.shape;
        let found: Option<[usize; 4]> = shape[..].try_into().ok();
        let matches = |found: [usize; 4]| (0..4).all(|i| expected[i].is_none_or(|e| e == found[i]));
        let found = found.filter(|&f| matches(f)).ok_or_else(|| {
            site.wrong_shape(
                "the weights",
                shape,
                &expected.map(|size| size.unwrap_or(0)),
            )
        })?;
        let packed = found[1..]
            .iter()
            .product::<usize>()
            .saturating_mul(found[0].next_multiple_of(PACKED_CHANNELS));
        self.packed_weights = self.packed_weights.saturating_add(packed);
        check_limit("number of weights", self.packed_weights, MAX_WEIGHTS)?;
        Ok(Weights {
            weights: self.floats(site, 1, "the weights")?,
            bias: self.floats(site, 2, "the biases")?,
            sizes: found,
        })
    }

    fn add_convolution(&mut self, site: Site) -> Result<(), ModelError> {
        site.require_one("horizontal dilation", 4)?;
        site.require_one("vertical dilation", 5)?;
        let (input, shape, pads) = self.padded_input(site)?;
        let Weights {
            weights,
            bias,
            sizes,
        } = self.weights(site, [None, None, None, Some(shape.channels)])?;
        let window = self.window(site, shape, [sizes[1], sizes[2]], pads)?;
        let activation = site.activation(3)?;
        let kernel = match bias[..] {
            [bias] => SingleConvolution::new(shape, window, &weights, bias, activation)
                .map(Kernel::Single),
            _ => Convolution::new(shape, window, &weights, &bias, activation)
                .map(Kernel::Convolution),
        };
        let kernel =
            kernel.ok_or_else(|| site.wrong_shape("the biases", &[bias.len()], &sizes[..1]))?;
        self.add_node(site, kernel, [input, input])
    }

    fn add_depthwise(&mut self, site: Site) -> Result<(), ModelError> {
        site.require_one("depth multiplier", 3)?;
        site.require_one("horizontal dilation", 5)?;
        site.require_one("vertical dilation", 6)?;
        let (input, shape, pads) = self.padded_input(site)?;
        let Weights {
            weights,
            bias,
            sizes,
        } = self.weights(site, [Some(1), None, None, Some(shape.channels)])?;
        let window = self.window(site, shape, [sizes[1], sizes[2]], pads)?;
        let kernel = Depthwise::new(shape, window, &weights, &bias, site.activation(4)?);
        let kernel = kernel.ok_or_else(|| {
            site.unsupported(
                "horizontal stride",
                window.columns.stride as i64,
                "1 or 2, and a bias per channel",
            )
        })?;
        self.add_node(site, Kernel::Depthwise(kernel), [input, input])
    }

    fn max_pool(&self, site: Site) -> Result<Kernel, ModelError> {
        let (_, input) = self.value(site, 0)?;
        let size =
            |slot| Ok::<_, ModelError>(usize::try_from(site.operator.int(slot, 1)?).unwrap_or(0));
        let window = self.window(site, input, [size(4)?, size(3)?], [[0; 2]; 2])?;
        Ok(Kernel::MaxPool(MaxPool {
            input,
            window,
            activation: site.activation(5)?,
        }))
    }

    fn pad(&self, site: Site) -> Result<Kernel, ModelError> {
        let (_, input) = self.value(site, 0)?;
        let pads = self.integers::<8>(site, 1, "the padding")?;
        if let Some(&found) = pads.iter().find(|p| !(0..=MAX_PADDING).contains(*p)) {
            return Err(site.unsupported("padding", found.into(), "0 to 4096"));
        }
        let [0, 0, pads @ ..] = pads.map(|p| p as usize) else {
            return Err(site.unsupported("padding of the batch", pads[0].into(), "0"));
        };
        let [rows, columns, channels] =
            [[pads[0], pads[1]], [pads[2], pads[3]], [pads[4], pads[5]]];
        Ok(Kernel::Pad(Pad {
            input,
            rows,
            columns,
            channels,
        }))
    }

    fn resize(&self, site: Site) -> Result<Kernel, ModelError> {
        let ((_, input), declared) = (self.value(site, 0)?, self.declared(site)?);
        let size = self.integers::<2>(site, 1, "the size")?;
        let alignment = match (site.operator.byte(2)?, site.operator.byte(3)?) {
            (0, 0) => Alignment::Origin,
            (0, _) => Alignment::HalfPixel,
            (_, 0) => Alignment::Corners,
            _ => return Err(site.unsupported("alignment", 3, "corners or half pixels, not both")),
        };
        let sizes = size.map(|s| usize::try_from(s).unwrap_or(0));
        if sizes != [declared.height, declared.width] {
            return Err(site.wrong_shape(
                "the output",
                &declared.sizes(),
                &[1, sizes[0], sizes[1], input.channels],
            ));
        }
        let kernel = Resize::new(input, declared.height, declared.width, alignment);
        kernel
            .map(Kernel::Resize)
            .ok_or_else(|| site.unsupported("size", size[0].into(), "at least 1"))
    }
}
