//! The sides of triangles, grouped by edges.

/// One side of one triangle
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TriangleSide {
    /// Start vertex, in the direction of the triangle
    pub from: u32,
    /// End vertex
    pub to: u32,
    /// Index of the triangle
    pub triangle: u32,
    /// Index of the side, 0 to 2; side `k` starts at corner `k`
    pub side: u32,
}

impl TriangleSide {
    /// Returns both vertices, the lower one first
    pub fn edge(&self) -> [u32; 2] {
        [self.from.min(self.to), self.from.max(self.to)]
    }

    /// Whether the side runs from its lower vertex to the higher one
    pub fn ascends(&self) -> bool {
        self.from < self.to
    }
}

/// Returns all sides in ascending order of edge, triangle and side
///
/// Bucket sort: linear in the number of triangles if few triangles meet at each vertex.
pub fn sides_by_edge(triangles: &[[u32; 3]]) -> Vec<TriangleSide> {
    let sides = || {
        triangles.iter().zip(0..).flat_map(|(corners, triangle)| {
            (0..3).map(move |side| TriangleSide {
                from: corners[side],
                to: corners[(side + 1) % 3],
                triangle,
                side: side as u32,
            })
        })
    };
    let lowest = |side: &TriangleSide| side.edge()[0] as usize;
    let count = sides().map(|s| lowest(&s) + 1).max().unwrap_or(0);
    // Indices of vertices that cannot all exist would make more buckets than there are sides.
    if count > 8 * triangles.len() + 1024 {
        let mut sorted: Vec<TriangleSide> = sides().collect();
        sorted.sort_by_key(|side| side.edge());
        return sorted;
    }
    let mut next = vec![0_u32; count + 1];
    for side in sides() {
        next[lowest(&side) + 1] += 1;
    }
    for v in 0..count {
        next[v + 1] += next[v];
    }
    let first = next.clone();
    let Some(any) = sides().next() else {
        return Vec::new();
    };
    let mut sorted = vec![any; 3 * triangles.len()];
    for side in sides() {
        let place = &mut next[lowest(&side)];
        sorted[*place as usize] = side;
        *place += 1;
    }
    for ends in first.windows(2) {
        // stable: within an edge, sides keep the order of triangles
        sorted[ends[0] as usize..ends[1] as usize].sort_by_key(|side| side.edge()[1]);
    }
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sides_are_sorted(triangles in prop::collection::vec(prop::array::uniform3(prop_oneof![20 => 0_u32..12, 1 => Just(u32::MAX)]), 0..40)) {
            let found = sides_by_edge(&triangles);
            let mut expected = Vec::new();
            for (t, &[a, b, c]) in triangles.iter().enumerate() {
                for (side, (from, to)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
                    expected.push(TriangleSide { from, to, triangle: t as u32, side: side as u32 });
                }
            }
            expected.sort_by_key(|s| (s.edge(), s.triangle, s.side));
            prop_assert_eq!(found, expected);
        }
    }
}
