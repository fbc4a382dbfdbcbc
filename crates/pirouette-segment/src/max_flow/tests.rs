use super::*;
use proptest::prelude::*;

/// Links as (node, direction, capacity) and terminals, sufficient for any graph on the grid
#[derive(Debug, Clone)]
struct Problem {
    nodes: Mask,
    links: Vec<[i32; 4]>,
    terminals: Vec<i32>,
}

fn build(problem: &Problem) -> GridCut {
    let mut cut = GridCut::new(&problem.nodes);
    for node in 0..cut.node_count() {
        let capacities = std::array::from_fn(|direction| {
            let Some(other) = cut.neighbor(node, direction) else {
                return 0;
            };
            let first = if direction % 2 == 0 { node } else { other };
            problem.links[first][direction / 2]
        });
        cut.set_links(node, capacities);
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

/// Cost of the labels: every link and terminal that they cut
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
fn neighbors_are_mutual() {
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
fn a_graph_without_nodes_has_no_flow() {
    let mut cut = GridCut::new(&Mask::filled(3, 3, false));
    assert_eq!(cut.solve(), 0);
    let mut cut = GridCut::new(&Mask::filled(0, 0, true));
    assert_eq!(cut.solve(), 0);
}

proptest! {
    #[test]
    fn flow_equals_the_reference_and_the_cost_of_its_cut(problem in problems()) {
        let mut cut = build(&problem);
        let flow = cut.solve();
        prop_assert_eq!(flow, max_flow_reference(&problem));
        prop_assert_eq!(flow, cost_of_labels(&problem, &cut));
    }

    #[test]
    fn continuing_after_terminal_changes_gives_the_cost_of_a_new_start(
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
