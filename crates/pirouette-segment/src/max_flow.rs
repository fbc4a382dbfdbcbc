//! Minimum cuts on the pixels of a photo.
//!
//! Only the undecided pixels become nodes; links to decided neighbors are terminal capacity. Capacities
//! are whole numbers, so that a cut is exact and the same on every machine. Flow that was found once stays
//! valid when only the terminal capacities change: the rounds of a segmentation continue where the last
//! one ended.
//!
//! Two trees grow from source and sink until they touch; the path between them is saturated and what lost
//! its parent is adopted or let go. This suits the shallow graphs of photos, where most nodes hang directly
//! on a terminal; its worst case is bad.

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

/// What the search knows of a node; 16 bytes
#[derive(Debug, Clone, Copy)]
struct SearchState {
    /// Residual capacity from the source, or to the sink when negative
    terminal: i32,
    /// When `distance` was last known to be right
    stamp: u32,
    /// Steps to the terminal along the tree, an estimate
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
    /// A graph without capacities; nodes are the `true` pixels, numbered row by row
    pub fn new(nodes: &Mask) -> Self {
        let (width, height) = (nodes.width(), nodes.height());
        let mut neighbors: Vec<[u32; 8]> = Vec::with_capacity(nodes.area());
        // the numbers of the row above and of this row suffice to link both ways
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

    /// Number of nodes
    pub fn node_count(&self) -> usize {
        self.neighbors.len()
    }

    /// The neighboring node in one of the [`DIRECTIONS`]
    pub fn neighbor(&self, node: usize, direction: usize) -> Option<usize> {
        let other = self.neighbors[node][direction];
        (other != NOWHERE).then_some(other as usize)
    }

    /// Adds capacity both ways between a node and its neighbor; nothing happens where there is no neighbor
    ///
    /// The capacity must not be negative.
    pub fn add_link(&mut self, node: usize, direction: usize, capacity: i32) {
        debug_assert!(capacity >= 0);
        if let Some(other) = self.neighbor(node, direction) {
            self.residuals[node][direction] += capacity;
            self.residuals[other][direction ^ 1] += capacity;
        }
    }

    /// Adds what it costs to cut a node off the source; negative: off the sink
    pub fn add_terminal(&mut self, node: usize, capacity: i32) {
        let terminal = &mut self.states[node].terminal;
        *terminal = terminal.saturating_add(capacity);
    }

    /// Whether the last [`GridCut::solve`] left the node on the source's side
    ///
    /// Nodes that the cut leaves free go to the sink.
    pub fn on_source_side(&self, node: usize) -> bool {
        let state = &self.states[node];
        state.parent != FREE && state.tree == Tree::Source
    }

    /// Pushes all flow from source to sink that the capacities let through; returns how much was pushed
    pub fn solve(&mut self) -> i64 {
        self.start_trees();
        let mut flow = 0;
        let mut current: Option<usize> = None;
        loop {
            let node = match current.take() {
                // a node that just gave a path often gives another one
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

    /// Hangs every node with terminal capacity on its terminal
    fn start_trees(&mut self) {
        self.active.clear();
        self.orphans.clear();
        self.time = 0;
        for (node, state) in self.states.iter_mut().enumerate() {
            state.stamp = 0;
            state.queued = state.terminal != 0;
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
            self.active.push_back(node as u32);
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

    /// Takes free neighbors into the node's tree; stops at the first link to the other tree and returns it
    /// as its node on the source's side and direction
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
                // a shorter way to the terminal
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
                self.orphan(node);
            }
            node = parent;
        }
        self.states[node].terminal -= flow;
        if self.states[node].terminal == 0 {
            self.orphan(node);
        }
        node = sink_end;
        while self.states[node].parent != TERMINAL {
            let to_parent = usize::from(self.states[node].parent & 7);
            let parent = self.neighbors[node][to_parent] as usize;
            self.residuals[node][to_parent] -= flow;
            self.residuals[parent][to_parent ^ 1] += flow;
            if self.residuals[node][to_parent] == 0 {
                self.orphan(node);
            }
            node = parent;
        }
        self.states[node].terminal += flow;
        if self.states[node].terminal == 0 {
            self.orphan(node);
        }
        flow
    }

    /// Cuts a node off its parent; those nearest to the terminal are looked after first
    fn orphan(&mut self, node: usize) {
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
                None => self.let_go(node),
            }
        }
    }

    /// The neighbor with a link to this orphan and the shortest way to the terminal, and that way's length
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

    /// Steps from a node to its terminal, `None` when an orphan is on the way; stamps what it passed
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

    /// Frees an orphan; its children become orphans, and neighbors that can take it back become active
    fn let_go(&mut self, node: usize) {
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
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Links as (node, direction, capacity) and terminals, enough to build any graph of the grid
    #[derive(Debug, Clone)]
    struct Problem {
        nodes: Mask,
        links: Vec<[i32; 4]>,
        terminals: Vec<i32>,
    }

    fn build(problem: &Problem) -> GridCut {
        let mut cut = GridCut::new(&problem.nodes);
        for node in 0..cut.node_count() {
            for (half, &capacity) in problem.links[node].iter().enumerate() {
                cut.add_link(node, 2 * half, capacity);
            }
            cut.add_terminal(node, problem.terminals[node]);
        }
        cut
    }

    /// Shortest augmenting paths on a full capacity matrix (Edmonds and Karp)
    fn max_flow_reference(problem: &Problem) -> i64 {
        let graph = GridCut::new(&problem.nodes);
        let count = graph.node_count();
        let (source, sink) = (count, count + 1);
        let mut capacity = vec![vec![0_i64; count + 2]; count + 2];
        for (node, links) in problem.links.iter().enumerate().take(count) {
            for (half, &c) in links.iter().enumerate() {
                if let Some(other) = graph.neighbor(node, 2 * half) {
                    capacity[node][other] += i64::from(c);
                    capacity[other][node] += i64::from(c);
                }
            }
            let terminal = i64::from(problem.terminals[node]);
            capacity[source][node] += terminal.max(0);
            capacity[node][sink] += (-terminal).max(0);
        }
        let mut flow = 0;
        loop {
            let mut from = vec![usize::MAX; count + 2];
            let mut queue = VecDeque::from([source]);
            while let Some(node) = queue.pop_front() {
                for other in 0..count + 2 {
                    if capacity[node][other] > 0 && from[other] == usize::MAX && other != source {
                        from[other] = node;
                        queue.push_back(other);
                    }
                }
            }
            if from[sink] == usize::MAX {
                return flow;
            }
            let path = |visit: &mut dyn FnMut(usize, usize)| {
                let mut node = sink;
                while node != source {
                    visit(from[node], node);
                    node = from[node];
                }
            };
            let mut least = i64::MAX;
            path(&mut |a, b| least = least.min(capacity[a][b]));
            let mut updates = Vec::new();
            path(&mut |a, b| updates.push((a, b)));
            for (a, b) in updates {
                capacity[a][b] -= least;
                capacity[b][a] += least;
            }
            flow += least;
        }
    }

    /// What the labels cost: every link and terminal that they cut
    fn cost_of_labels(problem: &Problem, cut: &GridCut) -> i64 {
        let mut cost = 0;
        for node in 0..cut.node_count() {
            for (half, &c) in problem.links[node].iter().enumerate() {
                if let Some(other) = cut.neighbor(node, 2 * half)
                    && cut.on_source_side(node) != cut.on_source_side(other)
                {
                    cost += i64::from(c);
                }
            }
            let terminal = i64::from(problem.terminals[node]);
            cost += if cut.on_source_side(node) {
                (-terminal).max(0)
            } else {
                terminal.max(0)
            };
        }
        cost
    }

    fn problems() -> impl Strategy<Value = Problem> {
        (1_usize..6, 1_usize..6).prop_flat_map(|(width, height)| {
            let size = width * height;
            (
                prop::collection::vec(prop::bool::weighted(0.8), size),
                prop::collection::vec(prop::array::uniform4(0_i32..12), size),
                prop::collection::vec(-20_i32..20, size),
            )
                .prop_map(move |(nodes, links, terminals)| Problem {
                    nodes: Mask::from_vec(width, height, nodes),
                    links,
                    terminals,
                })
        })
    }

    #[test]
    fn neighbors_point_at_each_other() {
        let cut = GridCut::new(&Mask::from_art("##. .## #.#"));
        assert_eq!(cut.node_count(), 6);
        // nodes: 0 (0,0), 1 (1,0), 2 (1,1), 3 (2,1), 4 (0,2), 5 (2,2)
        assert_eq!(cut.neighbor(0, 0), Some(1));
        assert_eq!(cut.neighbor(0, 4), Some(2));
        assert_eq!(cut.neighbor(1, 2), Some(2));
        assert_eq!(cut.neighbor(1, 4), Some(3));
        assert_eq!(cut.neighbor(2, 6), Some(4));
        assert_eq!(cut.neighbor(4, 7), Some(2));
        assert_eq!(cut.neighbor(4, 0), None);
        for node in 0..6 {
            for direction in 0..8 {
                if let Some(other) = cut.neighbor(node, direction) {
                    assert_eq!(cut.neighbor(other, direction ^ 1), Some(node));
                }
            }
        }
    }

    #[test]
    fn the_weakest_link_of_a_row_is_cut() {
        let problem = Problem {
            nodes: Mask::from_art("####"),
            links: vec![[9, 0, 0, 0], [2, 0, 0, 0], [9, 0, 0, 0], [0; 4]],
            terminals: vec![5, 0, 0, -5],
        };
        let mut cut = build(&problem);
        assert_eq!(cut.solve(), 2);
        let sides: Vec<bool> = (0..4).map(|n| cut.on_source_side(n)).collect();
        assert_eq!(sides, [true, true, false, false]);
    }

    #[test]
    fn no_nodes_no_flow() {
        let mut cut = GridCut::new(&Mask::filled(3, 3, false));
        assert_eq!(cut.solve(), 0);
        let mut cut = GridCut::new(&Mask::filled(0, 0, true));
        assert_eq!(cut.solve(), 0);
    }

    proptest! {
        #[test]
        fn flow_equals_the_reference_and_the_cost_of_its_own_cut(problem in problems()) {
            let mut cut = build(&problem);
            let flow = cut.solve();
            prop_assert_eq!(flow, max_flow_reference(&problem));
            prop_assert_eq!(flow, cost_of_labels(&problem, &cut));
        }

        #[test]
        fn continuing_after_new_terminals_finds_a_cut_as_cheap_as_starting_over(
            problem in problems(),
            changes in prop::collection::vec(-30_i32..30, 36),
        ) {
            let mut continued = build(&problem);
            continued.solve();
            let mut changed = problem.clone();
            for (node, &change) in changes.iter().enumerate().take(continued.node_count()) {
                continued.add_terminal(node, change);
                changed.terminals[node] += change;
            }
            continued.solve();
            prop_assert_eq!(cost_of_labels(&changed, &continued), max_flow_reference(&changed));
        }
    }
}
