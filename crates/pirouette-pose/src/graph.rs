//! From a TFLite file to a checked list of operators
//!
//! Shapes are computed from the inputs of each operator and compared with those in the file. Operators must follow the
//! operators whose results they read, and each tensor is computed once.

mod build;
mod fuse;
mod site;

use crate::ModelError;
use crate::flatbuffer::check_limit;
use crate::kernels::convolution::Convolution;
use crate::kernels::depthwise::Depthwise;
use crate::kernels::elementwise::{Pad, add, logistic};
use crate::kernels::expanded::Expanded;
use crate::kernels::pool::MaxPool;
use crate::kernels::resize::Resize;
use crate::kernels::single::SingleConvolution;
use crate::kernels::{Activation, Shape};
use crate::tflite::File;

/// Operator with its weights
#[derive(Debug)]
pub(crate) enum Kernel {
    Convolution(Convolution),
    Single(SingleConvolution),
    Depthwise(Depthwise),
    Expanded(Expanded),
    MaxPool(MaxPool),
    Pad(Pad),
    Resize(Resize),
    Add(Shape, Activation),
    Logistic(Shape),
}

impl Kernel {
    /// Size of the result
    pub(crate) fn result(&self) -> Shape {
        match self {
            Self::Convolution(k) => k.result(),
            Self::Single(k) => k.result(),
            Self::Depthwise(k) => k.result(),
            Self::Expanded(k) => k.result(),
            Self::MaxPool(k) => k.window.result(k.input.channels),
            Self::Pad(k) => k.result(),
            Self::Resize(k) => k.result(),
            Self::Add(shape, _) | Self::Logistic(shape) => *shape,
        }
    }

    /// Number of multiplications or comparable operations
    pub(crate) fn work(&self) -> usize {
        match self {
            Self::Convolution(k) => k.work(),
            Self::Single(k) => k.work(),
            Self::Depthwise(k) => k.work(),
            Self::Expanded(k) => k.work(),
            Self::MaxPool(k) => self.result().len().saturating_mul(k.window.area()),
            _ => self.result().len(),
        }
    }

    /// Length of the scratch memory
    pub(crate) fn scratch_len(&self) -> usize {
        match self {
            Self::Convolution(k) => k.scratch_len(),
            Self::Single(k) => k.scratch_len(),
            Self::Depthwise(k) => k.scratch_len(),
            Self::Expanded(k) => k.scratch_len(),
            Self::Resize(k) => k.scratch_len(),
            _ => 0,
        }
    }

    /// Computes the result from one or, for a sum, two inputs.
    pub(crate) fn run(&self, input: &[f32], second: &[f32], out: &mut [f32], scratch: &mut [f32]) {
        match self {
            Self::Convolution(k) => k.run(input, out, scratch),
            Self::Single(k) => k.run(input, out, scratch),
            Self::Depthwise(k) => k.run(input, out, scratch),
            Self::Expanded(k) => k.run(input, out, scratch),
            Self::MaxPool(k) => k.run(input, out),
            Self::Pad(k) => k.run(input, out),
            Self::Resize(k) => k.run(input, out, scratch),
            Self::Add(_, activation) => add(input, second, *activation, out),
            Self::Logistic(_) => out
                .iter_mut()
                .zip(input)
                .for_each(|(out, &x)| *out = logistic(x)),
        }
    }
}

/// Operator and the values that it reads and computes
#[derive(Debug)]
pub(crate) struct Node {
    pub(crate) kernel: Kernel,
    /// Numbers of values; equal for operators with one input
    pub(crate) inputs: [usize; 2],
    /// Number of the computed value
    pub(crate) output: usize,
}

impl Node {
    /// Numbers of the values that it reads, each once
    fn distinct_inputs(&self) -> &[usize] {
        &self.inputs[..1 + usize::from(self.inputs[0] != self.inputs[1])]
    }
}

/// Network in which all shapes and indices are checked
#[derive(Debug)]
pub(crate) struct Graph {
    /// Sizes of the values; value 0 is the input
    pub(crate) values: Vec<Shape>,
    /// Operators; each reads only values that earlier ones compute
    pub(crate) nodes: Vec<Node>,
    /// Values of the outputs, in the order of the file
    pub(crate) outputs: Vec<usize>,
}

impl Graph {
    /// Reads a network with one input.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, ModelError> {
        let file = File::read(bytes)?;
        Ok(build::Builder::new(&file, bytes.len())?.build()?.fused())
    }
}

/// Steps that compute some of the outputs, and the memory that they need
///
/// Memory of values that are not read anymore is used again.
#[derive(Debug)]
pub(crate) struct Schedule {
    steps: Vec<Step>,
    slot_lens: Vec<usize>,
    scratch_len: usize,
    input_slot: usize,
    output_slots: Vec<usize>,
}

#[derive(Debug)]
struct Step {
    node: usize,
    inputs: [usize; 2],
    output: usize,
}

/// Largest accepted memory of one run, in numbers of 4 bytes (256 MiB)
const MAX_MEMORY: usize = 1 << 26;
/// Largest accepted number of multiplications of one run; twice that of the largest known pose network
const MAX_WORK: usize = 4_000_000_000;

/// Memory of one run
#[derive(Debug, Default)]
pub(crate) struct Memory {
    slots: Vec<Vec<f32>>,
    scratch: Vec<f32>,
}

impl Schedule {
    /// Selects the operators that `outputs` (numbers of values) depend on, and assigns memory.
    pub(crate) fn new(graph: &Graph, outputs: &[usize]) -> Result<Self, ModelError> {
        let last_use = last_uses(graph, outputs);
        let mut slots = Slots::new(graph.values.len());
        let mut steps = Vec::new();
        let (mut work, mut scratch_len) = (0usize, 0usize);
        slots.occupy(0, graph.values[0].len());
        for (i, node) in graph
            .nodes
            .iter()
            .enumerate()
            .filter(|(_, n)| last_use[n.output].is_some())
        {
            slots.occupy(node.output, graph.values[node.output].len());
            steps.push(Step {
                node: i,
                inputs: node.inputs.map(|v| slots.slot_of[v]),
                output: slots.slot_of[node.output],
            });
            for &value in node.distinct_inputs() {
                if last_use[value] == Some(i) {
                    slots.release(value);
                }
            }
            work = work.saturating_add(node.kernel.work());
            scratch_len = scratch_len.max(node.kernel.scratch_len());
        }
        let memory = slots
            .lens
            .iter()
            .fold(scratch_len, |sum, &len| sum.saturating_add(len));
        check_limit("memory, in numbers of 4 bytes,", memory, MAX_MEMORY)?;
        check_limit("number of multiplications", work, MAX_WORK)?;
        Ok(Self {
            steps,
            scratch_len,
            input_slot: slots.slot_of[0],
            output_slots: outputs.iter().map(|&v| slots.slot_of[v]).collect(),
            slot_lens: slots.lens,
        })
    }

    /// Allocates the memory of one run.
    pub(crate) fn memory(&self) -> Memory {
        Memory {
            slots: self.slot_lens.iter().map(|&len| vec![0.0; len]).collect(),
            scratch: vec![0.0; self.scratch_len],
        }
    }

    /// Returns where the input is to be written before a run.
    pub(crate) fn input<'m>(&self, graph: &Graph, memory: &'m mut Memory) -> &'m mut [f32] {
        &mut memory.slots[self.input_slot][..graph.values[0].len()]
    }

    /// Returns an output after a run; `which` counts the outputs given to [`Self::new`].
    pub(crate) fn output<'m>(
        &self,
        graph: &Graph,
        outputs: &[usize],
        which: usize,
        memory: &'m Memory,
    ) -> &'m [f32] {
        &memory.slots[self.output_slots[which]][..graph.values[outputs[which]].len()]
    }

    /// Computes the outputs from the input.
    pub(crate) fn run(&self, graph: &Graph, memory: &mut Memory) {
        for step in &self.steps {
            let node = &graph.nodes[step.node];
            let mut out = std::mem::take(&mut memory.slots[step.output]);
            let value =
                |i: usize| &memory.slots[step.inputs[i]][..graph.values[node.inputs[i]].len()];
            let scratch = &mut memory.scratch[..node.kernel.scratch_len()];
            node.kernel.run(
                value(0),
                value(1),
                &mut out[..graph.values[node.output].len()],
                scratch,
            );
            memory.slots[step.output] = out;
        }
    }
}

/// Returns per value the last operator that reads it, the number of operators if it is an output, `None` if the
/// outputs do not depend on it.
fn last_uses(graph: &Graph, outputs: &[usize]) -> Vec<Option<usize>> {
    let mut last_use = vec![None; graph.values.len()];
    for &value in outputs {
        last_use[value] = Some(graph.nodes.len());
    }
    for (i, node) in graph.nodes.iter().enumerate().rev() {
        if last_use[node.output].is_some() {
            for &value in &node.inputs {
                last_use[value] = last_use[value].max(Some(i));
            }
        }
    }
    last_use
}

/// Assignment of values to memory
struct Slots {
    lens: Vec<usize>,
    free: Vec<usize>,
    slot_of: Vec<usize>,
}

impl Slots {
    fn new(value_count: usize) -> Self {
        Self {
            lens: Vec::new(),
            free: Vec::new(),
            slot_of: vec![usize::MAX; value_count],
        }
    }

    /// Assigns the free slot whose length is closest to `len`, enlarged if required, or a new one.
    fn occupy(&mut self, value: usize, len: usize) {
        let closest = (0..self.free.len()).min_by_key(|&i| self.lens[self.free[i]].abs_diff(len));
        let slot = match closest {
            Some(i) => self.free.swap_remove(i),
            None => {
                self.lens.push(0);
                self.lens.len() - 1
            }
        };
        self.lens[slot] = self.lens[slot].max(len);
        self.slot_of[value] = slot;
    }

    /// Makes the slot of a value available.
    fn release(&mut self, value: usize) {
        self.free.push(self.slot_of[value]);
    }
}

#[cfg(test)]
#[path = "../tests/tiny_model/mod.rs"]
mod tiny_model;

#[cfg(test)]
mod tests {
    use super::tiny_model::tiny_model;
    use super::{Graph, Kernel, Schedule, build};
    use crate::kernels::testing::{assert_close, noise};
    use crate::tflite::File;

    /// Computes all values one after the other, each with its own memory.
    fn run_reference(graph: &Graph, input: &[f32]) -> Vec<Vec<f32>> {
        let mut values = vec![input.to_vec(); graph.values.len()];
        for node in &graph.nodes {
            let mut out = vec![f32::NAN; graph.values[node.output].len()];
            let mut scratch = vec![f32::NAN; node.kernel.scratch_len()];
            let [first, second] = node.inputs.map(|value| &values[value][..]);
            node.kernel.run(first, second, &mut out, &mut scratch);
            values[node.output] = out;
        }
        values
    }

    #[test]
    fn schedules_of_the_fused_graph_equal_the_operators_one_after_the_other() {
        let bytes = tiny_model();
        let file = File::read(&bytes).unwrap();
        let graph = build::Builder::new(&file, bytes.len())
            .unwrap()
            .build()
            .unwrap();
        let input = noise(graph.values[0].len(), 1);
        let expected = run_reference(&graph, &input);
        let fused = graph.fused();
        assert_eq!(
            fused
                .nodes
                .iter()
                .filter(|n| matches!(n.kernel, Kernel::Expanded(_)))
                .count(),
            1
        );

        // Each set of outputs, in memory that the run before has used
        for set in 1..1usize << fused.outputs.len() {
            let outputs: Vec<usize> = (0..fused.outputs.len())
                .filter(|i| set >> i & 1 == 1)
                .map(|i| fused.outputs[i])
                .collect();
            let schedule = Schedule::new(&fused, &outputs).unwrap();
            let mut memory = schedule.memory();
            for _ in 0..2 {
                schedule.input(&fused, &mut memory).copy_from_slice(&input);
                schedule.run(&fused, &mut memory);
                for (which, &value) in outputs.iter().enumerate() {
                    assert_close(
                        schedule.output(&fused, &outputs, which, &memory),
                        &expected[value],
                        1e-5,
                    );
                }
            }
        }
    }

    #[test]
    fn memory_is_used_again() {
        let graph = Graph::parse(&tiny_model()).unwrap();
        let schedule = Schedule::new(&graph, &graph.outputs).unwrap();
        let all: usize = graph.values.iter().map(|v| v.len()).sum();
        assert!(schedule.slot_lens.iter().sum::<usize>() < all / 2);
    }

    #[test]
    fn padding_is_part_of_the_convolution_that_reads_it() {
        let graph = Graph::parse(&tiny_model()).unwrap();
        assert!(
            !graph
                .nodes
                .iter()
                .any(|n| matches!(n.kernel, Kernel::Pad(_)))
        );
    }
}
