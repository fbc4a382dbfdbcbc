//! Joins operators

use super::{Graph, Kernel, Node};
use crate::kernels::expanded::Expanded;

impl Graph {
    /// Removes operators on which no output depends, and joins pointwise convolutions with the depthwise ones that are
    /// their only readers.
    pub(super) fn fused(mut self) -> Self {
        let last_use = super::last_uses(&self, &self.outputs);
        self.nodes.retain(|node| last_use[node.output].is_some());
        let mut readers = vec![0usize; self.values.len()];
        self.outputs.iter().for_each(|&value| readers[value] += 1);
        self.nodes
            .iter()
            .flat_map(|node| node.distinct_inputs())
            .for_each(|&value| readers[value] += 1);

        let mut fused: Vec<Node> = Vec::with_capacity(self.nodes.len());
        for node in self.nodes {
            let expansion = fused
                .iter()
                .position(|n| n.output == node.inputs[0] && is_pointwise(&n.kernel));
            let expansion = expansion.filter(|_| readers[node.inputs[0]] == 1);
            let (Some(place), Kernel::Depthwise(_)) = (expansion, &node.kernel) else {
                fused.push(node);
                continue;
            };
            let expansion = fused.remove(place);
            fused.push(join(expansion, node));
        }
        self.nodes = fused;
        self
    }
}

fn is_pointwise(kernel: &Kernel) -> bool {
    matches!(kernel, Kernel::Convolution(convolution) if convolution.is_pointwise())
}

/// Joins a pointwise convolution with a depthwise one; returns the latter if they are others.
fn join(expansion: Node, node: Node) -> Node {
    match (expansion.kernel, node.kernel) {
        (Kernel::Convolution(first), Kernel::Depthwise(second)) => Node {
            kernel: Kernel::Expanded(Expanded::new(first.into_matrix(), second)),
            inputs: expansion.inputs,
            output: node.output,
        },
        (_, kernel) => Node { kernel, ..node },
    }
}
