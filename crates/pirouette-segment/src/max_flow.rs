//! Minimum cuts on the pixels of a photo.
//!
//! Only the undecided pixels become nodes; links to decided neighbors are terminal capacity. Capacities are integers,
//! so that a cut is exact and equal on every machine. Flow remains valid when only the terminal capacities change: each
//! round of a segmentation continues from the previous one.
//!
//! Two trees grow from source and sink until they touch; the path between them is saturated, and nodes that lost their
//! parent are adopted or freed. This suits the shallow graphs of photos, where most nodes are directly attached to a
//! terminal; the worst case is slow.

use std::collections::VecDeque;

use pirouette_geom::Mask;

/// Steps to the eight neighbors; each even one is followed by its opposite
pub const DIRECTIONS: [(isize, isize); 8] = [
    (1, 0),
    (-1, 0),
    (0, 1),
    (0, -1),
    (1, 1),
    (-1, -1),
    (-1, 1),
    (1, -1),
];

/// No neighbor in this direction
const NOWHERE: u32 = u32::MAX;

/// Values of `SearchState::parent` beyond the eight directions
const TERMINAL: u8 = 8;
const FREE: u8 = 9;
const ORPHAN: u8 = 10;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tree {
    Source,
    Sink,
}

/// Search state of a node; 16 bytes
#[derive(Debug, Clone, Copy)]
struct SearchState {
    /// Residual capacity from the source, or to the sink when negative
    terminal: i32,
    /// Time at which `distance` was last valid
    stamp: u32,
    /// Estimated number of steps to the terminal along the tree
    distance: u32,
    /// Direction to the parent, or one of the values above
    parent: u8,
    tree: Tree,
    queued: bool,
}

/// A graph of the marked pixels of a grid, each linked to up to eight neighbors, and the flow through it
///
/// # Source
/// Y. Boykov, V. Kolmogorov, 2004, An experimental comparison of min-cut/max-flow algorithms for energy
/// minimization in vision, section 3, with the distance and time stamps named there as heuristics.
/// Continuing after a change of terminal capacities: P. Kohli, P. Torr, 2005, Efficiently solving dynamic
/// Markov random fields using graph cuts.
#[derive(Debug)]
pub struct GridCut {
    neighbors: Vec<[u32; 8]>,
    residuals: Vec<[i32; 8]>,
    states: Vec<SearchState>,
    active: VecDeque<u32>,
    orphans: VecDeque<u32>,
    time: u32,
}

impl GridCut {
    /// Creates a graph without capacities; nodes are the `true` pixels, numbered row by row
    pub fn new(nodes: &Mask) -> Self {
        let (width, height) = (nodes.width(), nodes.height());
        let mut neighbors: Vec<[u32; 8]> = Vec::with_capacity(nodes.area());
        // the node indices of the row above and of this row suffice to link both directions
        let mut above = vec![NOWHERE; width + 2];
        let mut current = vec![NOWHERE; width + 2];
        for y in 0..height {
            for (x, &is_node) in nodes.row(y).iter().enumerate() {
                current[x + 1] = NOWHERE;
                if !is_node {
                    continue;
                }
                let node = neighbors.len() as u32;
                current[x + 1] = node;
                let mut links = [NOWHERE; 8];
                for (direction, other) in [
                    (1, current[x]),
                    (3, above[x + 1]),
                    (5, above[x]),
                    (7, above[x + 2]),
                ] {
                    if other != NOWHERE {
                        links[direction] = other;
                        neighbors[other as usize][direction ^ 1] = node;
                    }
                }
                neighbors.push(links);
            }
            std::mem::swap(&mut above, &mut current);
        }
        let count = neighbors.len();
        let state = SearchState {
            terminal: 0,
            stamp: 0,
            distance: 0,
            parent: FREE,
            tree: Tree::Sink,
            queued: false,
        };
        Self {
            neighbors,
            residuals: vec![[0; 8]; count],
            states: vec![state; count],
            active: VecDeque::new(),
            orphans: VecDeque::new(),
            time: 0,
        }
    }

    /// Returns the number of nodes
    pub fn node_count(&self) -> usize {
        self.neighbors.len()
    }

    /// Returns the neighboring node in one of the [`DIRECTIONS`]
    pub fn neighbor(&self, node: usize, direction: usize) -> Option<usize> {
        let other = self.neighbors[node][direction];
        (other != NOWHERE).then_some(other as usize)
    }

    /// Sets the capacities between a node and its neighbors in all [`DIRECTIONS`]
    ///
    /// Capacities must be nonnegative, 0 where there is no neighbor, and equal at both ends of a link; so the links of
    /// every node must be set. Discards existing flow.
    pub fn set_links(&mut self, node: usize, capacities: [i32; 8]) {
        debug_assert!(
            (0..8).all(|d| capacities[d] >= 0
                && (capacities[d] == 0 || self.neighbors[node][d] != NOWHERE))
        );
        self.residuals[node] = capacities;
    }

    /// Adds the cost of separating a node from the source; negative: from the sink
    pub fn add_terminal(&mut self, node: usize, capacity: i32) {
        let terminal = &mut self.states[node].terminal;
        *terminal = terminal.saturating_add(capacity);
    }

    /// Whether the node is on the source's side of the last [`GridCut::solve`]
    ///
    /// Nodes on neither side count as the sink's.
    pub fn on_source_side(&self, node: usize) -> bool {
        let state = &self.states[node];
        state.parent != FREE && state.tree == Tree::Source
    }

    /// Pushes the maximum flow from source to sink; returns the added flow
    pub fn solve(&mut self) -> i64 {
        let mut flow = self.push_between_neighbors();
        self.start_trees();
        let mut current: Option<usize> = None;
        loop {
            let node = match current.take() {
                // a node on an augmenting path often gives another one
                Some(node) if self.states[node].parent < FREE => node,
                _ => match self.next_active() {
                    Some(node) => node,
                    None => break,
                },
            };
            if let Some((source_end, direction)) = self.grow(node) {
                self.time += 1;
                flow += i64::from(self.augment(source_end, direction));
                self.adopt_orphans();
                current = Some(node);
            }
        }
        flow
    }

    /// Pushes flow over paths of a single link between source and sink; returns the added flow
    ///
    /// This is most of the flow in photos, and needs no trees.
    fn push_between_neighbors(&mut self) -> i64 {
        let mut flow = 0;
        for node in 0..self.neighbors.len() {
            let mut terminal = self.states[node].terminal;
            // The other direction of each pair is handled at the neighbor.
            for direction in (0..8).step_by(2) {
                let other = self.neighbors[node][direction];
                if other == NOWHERE || terminal == 0 {
                    continue;
                }
                let other = other as usize;
                let across = self.states[other].terminal;
                // Flow that can be pushed from the node to the other one; backward if negative
                let pushed = if terminal > 0 && across < 0 {
                    let capacity = self.residuals[node][direction];
                    terminal.min(across.saturating_neg()).min(capacity)
                } else if terminal < 0 && across > 0 {
                    let capacity = self.residuals[other][direction ^ 1];
                    -across.min(terminal.saturating_neg()).min(capacity)
                } else {
                    continue;
                };
                self.residuals[node][direction] -= pushed;
                self.residuals[other][direction ^ 1] += pushed;
                terminal -= pushed;
                self.states[other].terminal += pushed;
                flow += i64::from(pushed.abs());
            }
            self.states[node].terminal = terminal;
        }
        flow
    }

    /// Attaches every node with terminal capacity to its terminal, and activates those next to which a tree can grow
    fn start_trees(&mut self) {
        self.active.clear();
        self.orphans.clear();
        self.time = 0;
        for state in &mut self.states {
            state.stamp = 0;
            state.queued = false;
            if state.terminal == 0 {
                state.parent = FREE;
                continue;
            }
            state.tree = if state.terminal > 0 {
                Tree::Source
            } else {
                Tree::Sink
            };
            state.parent = TERMINAL;
            state.distance = 1;
        }
        for node in 0..self.states.len() {
            let state = self.states[node];
            let open = |(direction, &other): (usize, &u32)| {
                let Some(beside) = self.states.get(other as usize) else {
                    return false;
                };
                let capacity = match state.tree {
                    Tree::Source => self.residuals[node][direction],
                    Tree::Sink => self.residuals[other as usize][direction ^ 1],
                };
                capacity > 0 && (beside.parent == FREE || beside.tree != state.tree)
            };
            if state.parent == TERMINAL && self.neighbors[node].iter().enumerate().any(open) {
                self.activate(node);
            }
        }
    }

    fn next_active(&mut self) -> Option<usize> {
        while let Some(node) = self.active.pop_front() {
            let state = &mut self.states[node as usize];
            state.queued = false;
            if state.parent != FREE {
                return Some(node as usize);
            }
        }
        None
    }

    fn activate(&mut self, node: usize) {
        let state = &mut self.states[node];
        if !state.queued {
            state.queued = true;
            self.active.push_back(node as u32);
        }
    }

    /// Adds free neighbors to the node's tree; stops at the first link to the other tree and returns it as its node
    /// on the source's side and direction
    fn grow(&mut self, node: usize) -> Option<(usize, usize)> {
        let SearchState {
            stamp,
            distance,
            tree,
            ..
        } = self.states[node];
        let links = self.neighbors[node];
        let residuals = self.residuals[node];
        for (direction, other) in links.into_iter().enumerate() {
            if other == NOWHERE {
                continue;
            }
            let other = other as usize;
            let capacity = match tree {
                Tree::Source => residuals[direction],
                Tree::Sink => self.residuals[other][direction ^ 1],
            };
            if capacity == 0 {
                continue;
            }
            let state = &mut self.states[other];
            if state.parent == FREE {
                state.tree = tree;
                state.parent = (direction ^ 1) as u8;
                state.stamp = stamp;
                state.distance = distance + 1;
                self.activate(other);
            } else if state.tree != tree {
                return Some(match tree {
                    Tree::Source => (node, direction),
                    Tree::Sink => (other, direction ^ 1),
                });
            } else if state.stamp <= stamp && state.distance > distance {
                // a shorter path to the terminal
                state.parent = (direction ^ 1) as u8;
                state.stamp = stamp;
                state.distance = distance + 1;
            }
        }
        None
    }

    /// Saturates the path through the link from `source_end` in `direction`; returns the flow
    fn augment(&mut self, source_end: usize, direction: usize) -> i32 {
        let sink_end = self.neighbors[source_end][direction] as usize;
        let mut flow = self.residuals[source_end][direction];
        let mut node = source_end;
        while self.states[node].parent != TERMINAL {
            let to_parent = usize::from(self.states[node].parent & 7);
            node = self.neighbors[node][to_parent] as usize;
            flow = flow.min(self.residuals[node][to_parent ^ 1]);
        }
        flow = flow.min(self.states[node].terminal);
        node = sink_end;
        while self.states[node].parent != TERMINAL {
            let to_parent = usize::from(self.states[node].parent & 7);
            flow = flow.min(self.residuals[node][to_parent]);
            node = self.neighbors[node][to_parent] as usize;
        }
        flow = flow.min(-self.states[node].terminal);

        self.residuals[source_end][direction] -= flow;
        self.residuals[sink_end][direction ^ 1] += flow;
        node = source_end;
        while self.states[node].parent != TERMINAL {
            let to_parent = usize::from(self.states[node].parent & 7);
            let parent = self.neighbors[node][to_parent] as usize;
            self.residuals[node][to_parent] += flow;
            self.residuals[parent][to_parent ^ 1] -= flow;
            if self.residuals[parent][to_parent ^ 1] == 0 {
                self.make_orphan(node);
            }
            node = parent;
        }
        self.states[node].terminal -= flow;
        if self.states[node].terminal == 0 {
            self.make_orphan(node);
        }
        node = sink_end;
        while self.states[node].parent != TERMINAL {
            let to_parent = usize::from(self.states[node].parent & 7);
            let parent = self.neighbors[node][to_parent] as usize;
            self.residuals[node][to_parent] -= flow;
            self.residuals[parent][to_parent ^ 1] += flow;
            if self.residuals[node][to_parent] == 0 {
                self.make_orphan(node);
            }
            node = parent;
        }
        self.states[node].terminal += flow;
        if self.states[node].terminal == 0 {
            self.make_orphan(node);
        }
        flow
    }

    /// Detaches a node from its parent; orphans nearest to the terminal are processed first
    fn make_orphan(&mut self, node: usize) {
        self.states[node].parent = ORPHAN;
        self.orphans.push_front(node as u32);
    }

    fn adopt_orphans(&mut self) {
        while let Some(node) = self.orphans.pop_front() {
            let node = node as usize;
            match self.best_parent(node) {
                Some((direction, distance)) => {
                    let state = &mut self.states[node];
                    state.parent = direction as u8;
                    state.stamp = self.time;
                    state.distance = distance + 1;
                }
                None => self.free_orphan(node),
            }
        }
    }

    /// Returns the best parent of an orphan, the linked neighbor nearest to the terminal, and the path length
    fn best_parent(&mut self, node: usize) -> Option<(usize, u32)> {
        let tree = self.states[node].tree;
        let links = self.neighbors[node];
        let mut best: Option<(usize, u32)> = None;
        for (direction, other) in links.into_iter().enumerate() {
            if other == NOWHERE {
                continue;
            }
            let other = other as usize;
            let state = &self.states[other];
            if state.parent >= FREE || state.tree != tree {
                continue;
            }
            let capacity = match tree {
                Tree::Source => self.residuals[other][direction ^ 1],
                Tree::Sink => self.residuals[node][direction],
            };
            if capacity == 0 {
                continue;
            }
            if let Some(distance) = self.distance_to_terminal(other)
                && best.is_none_or(|(_, shortest)| distance < shortest)
            {
                best = Some((direction, distance));
            }
        }
        best
    }

    /// Returns the steps from a node to its terminal, `None` via an orphan; stamps the nodes on the path
    fn distance_to_terminal(&mut self, start: usize) -> Option<u32> {
        let mut steps = 0;
        let mut node = start;
        let total = loop {
            let state = &mut self.states[node];
            if state.stamp == self.time {
                break steps + state.distance;
            }
            steps += 1;
            match state.parent {
                TERMINAL => {
                    state.stamp = self.time;
                    state.distance = 1;
                    break steps;
                }
                parent @ 0..TERMINAL => {
                    node = self.neighbors[node][usize::from(parent & 7)] as usize;
                }
                _ => return None,
            }
        };
        let mut distance = total;
        node = start;
        while self.states[node].stamp != self.time {
            let state = &mut self.states[node];
            state.stamp = self.time;
            state.distance = distance;
            distance -= 1;
            node = self.neighbors[node][usize::from(state.parent & 7)] as usize;
        }
        Some(total)
    }

    /// Frees an orphan; its children become orphans, and neighbors that can adopt it become active
    fn free_orphan(&mut self, node: usize) {
        let tree = self.states[node].tree;
        let links = self.neighbors[node];
        for (direction, other) in links.into_iter().enumerate() {
            if other == NOWHERE {
                continue;
            }
            let other = other as usize;
            let state = self.states[other];
            if state.parent == FREE || state.tree != tree {
                continue;
            }
            let capacity = match tree {
                Tree::Source => self.residuals[other][direction ^ 1],
                Tree::Sink => self.residuals[node][direction],
            };
            if capacity > 0 {
                self.activate(other);
            }
            if usize::from(state.parent) == direction ^ 1 {
                self.states[other].parent = ORPHAN;
                self.orphans.push_back(other as u32);
            }
        }
        self.states[node].parent = FREE;
    }
}

#[cfg(test)]
mod tests;
