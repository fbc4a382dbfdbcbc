//! Arrangement of closed polylines: edges that meet only at their ends, with winding numbers.
//!
//! Real contours touch themselves, run back and forth over one-pixel bridges, and cross themselves after
//! simplification. A constrained triangulation requires edges without any of that. All coordinates are integer
//! multiples of [`GRID_PX`], so every test here is exact; crossings are rounded to that grid, which may let an edge
//! run into a neighbor, so the search repeats until there is nothing left to split (iterated snap rounding,
//! Halperin & Packer 2002).

use std::collections::{HashMap, HashSet};

use glam::DVec2;

/// Grid steps per pixel
///
/// A thousandth of a pixel is far below the accuracy of any contour; coarser grids move corners visibly, finer ones
/// leave less room for exact products of coordinates.
const STEPS_PER_PX: f64 = 1024.0;

/// Spacing of the grid that coordinates are rounded to, in px
pub(crate) const GRID_PX: f64 = 1.0 / STEPS_PER_PX;

/// Maximum absolute coordinate in px; larger ones would overflow the exact products of grid coordinates
pub(crate) const MAX_COORDINATE_PX: f64 = 131_072.0;

/// Maximum rounds of splitting; remaining intersections are ignored
///
/// Usually one or two suffice; noise with thousands of self-crossings took four.
const MAX_ROUNDS: usize = 32;

/// A point on the grid
pub(crate) type GridPoint = [i64; 2];

/// Rounds to the grid; the point must be finite and within [`MAX_COORDINATE_PX`]
pub(crate) fn to_grid(p: DVec2) -> GridPoint {
    [
        (p.x * STEPS_PER_PX).round() as i64,
        (p.y * STEPS_PER_PX).round() as i64,
    ]
}

/// Returns the exact position of a grid point, in px
pub(crate) fn from_grid(p: GridPoint) -> DVec2 {
    DVec2::new(p[0] as f64, p[1] as f64) / STEPS_PER_PX
}

/// An edge of the arrangement
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ArrangedEdge {
    /// Smaller vertex
    pub(crate) from: u32,
    /// Larger vertex
    pub(crate) to: u32,
    /// Winding number on the side of positive orientation (left, if y were up) of `from -> to`, minus that on the other
    pub(crate) winding: i32,
}

/// Edges that meet only at their ends
#[derive(Debug, Clone, Default)]
pub(crate) struct Arrangement {
    /// Distinct grid points; some may not be on any edge
    pub(crate) points: Vec<GridPoint>,
    /// Distinct edges whose two sides differ in winding number
    pub(crate) edges: Vec<ArrangedEdge>,
    /// Index in `points` of each point of each loop
    pub(crate) loop_points: Vec<Vec<u32>>,
}

/// Arranges closed loops of finite points
pub(crate) fn arrange<'a>(loops: impl Iterator<Item = &'a [DVec2]>) -> Arrangement {
    let mut points = Points::default();
    let loop_points: Vec<Vec<u32>> = loops
        .map(|l| l.iter().map(|&p| points.insert(to_grid(p))).collect())
        .collect();
    let mut edges: Vec<[u32; 2]> = Vec::new();
    for vertices in &loop_points {
        let next = vertices.iter().cycle().skip(1);
        edges.extend(vertices.iter().zip(next).map(|(&a, &b)| [a, b]));
    }
    let mut edges = merge(&edges.iter().map(|&[a, b]| (a, b, 1)).collect::<Vec<_>>());
    for _ in 0..MAX_ROUNDS {
        let Some(split) = split_once(&mut points, &edges) else {
            break;
        };
        edges = merge(&split);
    }
    Arrangement {
        points: points.list,
        edges,
        loop_points,
    }
}

impl Arrangement {
    /// Intervals of nonzero winding on the horizontal line at `y`, sorted by x
    pub(crate) fn inside_spans(&self, y: f64) -> Vec<(f64, f64)> {
        let mut crossings: Vec<(f64, i32)> = self
            .edges
            .iter()
            .filter_map(|edge| {
                let (a, b) = self.ends(edge);
                let crosses = (a.y <= y) != (b.y <= y);
                crosses.then(|| {
                    let step = if a.y < b.y {
                        -edge.winding
                    } else {
                        edge.winding
                    };
                    (crossing_x(a, b, y), step)
                })
            })
            .collect();
        crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut spans = Vec::new();
        let (mut winding, mut start) = (0, 0.0);
        for (x, step) in crossings {
            if winding == 0 {
                start = x;
            }
            winding += step;
            if winding == 0 && x > start {
                spans.push((start, x));
            }
        }
        spans
    }

    /// Returns the ends of an edge, in px
    pub(crate) fn ends(&self, edge: &ArrangedEdge) -> (DVec2, DVec2) {
        (
            from_grid(self.points[edge.from as usize]),
            from_grid(self.points[edge.to as usize]),
        )
    }

    /// Splits every edge into equal parts of at most `max_length` px
    ///
    /// The new points are rounded to the grid; parts of a slanted edge stay within one grid step of it.
    pub(crate) fn subdivide(&mut self, max_length: f64) {
        let mut points = Points::from_list(std::mem::take(&mut self.points));
        let mut parts: Vec<(u32, u32, i32)> = Vec::with_capacity(self.edges.len());
        for edge in &self.edges {
            let a = from_grid(points.list[edge.from as usize]);
            let b = from_grid(points.list[edge.to as usize]);
            let count = (a.distance(b) / max_length).ceil().max(1.0) as usize;
            let mut last = edge.from;
            for i in 1..count {
                let p = a.lerp(b, i as f64 / count as f64);
                let next = points.insert(to_grid(p));
                parts.push((last, next, edge.winding));
                last = next;
            }
            parts.push((last, edge.to, edge.winding));
        }
        self.edges = merge(&parts);
        for _ in 0..MAX_ROUNDS {
            let Some(split) = split_once(&mut points, &self.edges) else {
                break;
            };
            self.edges = merge(&split);
        }
        self.points = points.list;
    }
}

/// Index for inside tests: edges by the bands of y that they overlap
pub(crate) struct Inside {
    low: DVec2,
    high: DVec2,
    band_height: f64,
    /// Edges of band `b` are `edges[first[b]..first[b + 1]]`
    first: Vec<usize>,
    edges: Vec<(DVec2, DVec2, i32)>,
}

impl Inside {
    pub(crate) fn new(arrangement: &Arrangement) -> Self {
        let ends: Vec<(DVec2, DVec2, i32)> = arrangement
            .edges
            .iter()
            .map(|edge| {
                let (a, b) = arrangement.ends(edge);
                (a, b, edge.winding)
            })
            .collect();
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut rise = 0.0;
        for (a, b, _) in &ends {
            low = low.min(a.min(*b));
            high = high.max(a.max(*b));
            rise += (b.y - a.y).abs();
        }
        // Roughly as high as the edges, so that each overlaps two or three bands
        let band_height = (rise / ends.len().max(1) as f64).max(GRID_PX);
        let count = (((high.y - low.y) / band_height) as usize).clamp(1, ends.len().max(1));
        let mut inside = Self {
            low,
            high,
            band_height: band_height.max((high.y - low.y) / count as f64),
            first: vec![0; count + 1],
            edges: Vec::new(),
        };
        let bands = |inside: &Self, (a, b, _): &(DVec2, DVec2, i32)| {
            inside.band(a.y.min(b.y))..=inside.band(a.y.max(b.y))
        };
        let mut in_band: Vec<(usize, usize)> = Vec::with_capacity(3 * ends.len());
        for (index, edge) in ends.iter().enumerate() {
            in_band.extend(bands(&inside, edge).map(|band| (band, index)));
        }
        in_band.sort_unstable();
        for &(band, index) in &in_band {
            inside.first[band + 1] += 1;
            inside.edges.push(ends[index]);
        }
        for band in 0..count {
            inside.first[band + 1] += inside.first[band];
        }
        inside
    }

    fn band(&self, y: f64) -> usize {
        let last = self.first.len().saturating_sub(2);
        (((y - self.low.y) / self.band_height) as usize).min(last)
    }

    /// Returns the bounding box of all edges
    pub(crate) fn bounds(&self) -> (DVec2, DVec2) {
        (self.low, self.high)
    }

    /// Whether the winding number around a point is not zero; the point must not lie on an edge
    pub(crate) fn contains(&self, p: DVec2) -> bool {
        self.winding_at(p) != 0
    }

    fn winding_at(&self, p: DVec2) -> i32 {
        if !(p.y >= self.low.y && p.y <= self.high.y) {
            return 0;
        }
        let band = self.band(p.y);
        let mut winding = 0;
        for &(a, b, step) in &self.edges[self.first[band]..self.first[band + 1]] {
            if (a.y <= p.y) != (b.y <= p.y) && crossing_x(a, b, p.y) > p.x {
                // the ray to +x leaves through an edge that runs down the screen, from its inner side
                winding += if a.y < b.y { step } else { -step };
            }
        }
        winding
    }
}

/// Distinct points in order of first appearance
#[derive(Debug, Default)]
struct Points {
    list: Vec<GridPoint>,
    index: HashMap<GridPoint, u32>,
}

impl Points {
    fn from_list(list: Vec<GridPoint>) -> Self {
        let index = list
            .iter()
            .enumerate()
            .map(|(i, &p)| (p, i as u32))
            .collect();
        Self { list, index }
    }

    fn insert(&mut self, p: GridPoint) -> u32 {
        *self.index.entry(p).or_insert_with(|| {
            self.list.push(p);
            self.list.len() as u32 - 1
        })
    }
}

/// Merges equal directed edges `(from, to, winding)`
///
/// Drops those from a point to itself, and those that cancel out, which enclose nothing.
fn merge(directed: &[(u32, u32, i32)]) -> Vec<ArrangedEdge> {
    let mut edges: Vec<ArrangedEdge> = directed
        .iter()
        .filter(|(a, b, _)| a != b)
        .map(|&(a, b, winding)| ArrangedEdge {
            from: a.min(b),
            to: a.max(b),
            winding: if a < b { winding } else { -winding },
        })
        .collect();
    edges.sort_by_key(|e| (e.from, e.to));
    edges.dedup_by(|next, kept| {
        let same = (next.from, next.to) == (kept.from, kept.to);
        if same {
            kept.winding += next.winding;
        }
        same
    });
    edges.retain(|e| e.winding != 0);
    edges
}

/// Splits all edges where others touch or cross them; `None` when there are no such edges
fn split_once(points: &mut Points, edges: &[ArrangedEdge]) -> Option<Vec<(u32, u32, i32)>> {
    let mut cuts: Vec<Vec<u32>> = vec![Vec::new(); edges.len()];
    let mut found = false;
    let mut seen: HashSet<(usize, u32)> = HashSet::new();
    let mut cut = |edge: usize, vertex: u32, cuts: &mut Vec<Vec<u32>>| {
        if vertex != edges[edge].from && vertex != edges[edge].to && seen.insert((edge, vertex)) {
            cuts[edge].push(vertex);
            found = true;
        }
    };
    let segments: Vec<[GridPoint; 2]> = edges
        .iter()
        .map(|e| [e.from, e.to].map(|v| points.list[v as usize]))
        .collect();
    for (i, j) in overlapping_boxes(&segments) {
        match meeting(segments[i], segments[j]) {
            None => {}
            Some(Meeting::Crossing(t)) => {
                let [a, b] = segments[i];
                let p = [0, 1].map(|k| (a[k] as f64 + t * (b[k] - a[k]) as f64).round() as i64);
                let vertex = points.insert(p);
                cut(i, vertex, &mut cuts);
                cut(j, vertex, &mut cuts);
            }
            Some(Meeting::Touch(inside)) => {
                let (e, f) = (edges[i], edges[j]);
                let ends = [(j, e.from), (j, e.to), (i, f.from), (i, f.to)];
                for ((edge, vertex), _) in ends.into_iter().zip(inside).filter(|(_, is)| *is) {
                    cut(edge, vertex, &mut cuts);
                }
            }
        }
    }
    if !found {
        return None;
    }
    let mut parts = Vec::with_capacity(edges.len() * 2);
    for (edge, mut vertices) in edges.iter().zip(cuts) {
        let a = points.list[edge.from as usize];
        let b = points.list[edge.to as usize];
        let along = |v: &u32| {
            let p = points.list[*v as usize];
            (p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])
        };
        vertices.sort_by_key(along);
        let mut last = edge.from;
        for v in vertices.into_iter().chain([edge.to]) {
            parts.push((last, v, edge.winding));
            last = v;
        }
    }
    Some(parts)
}

/// Finds pairs of segments whose bounding boxes overlap, by a sweep down the screen
pub(crate) fn overlapping_boxes(segments: &[[GridPoint; 2]]) -> Vec<(usize, usize)> {
    struct Bounds {
        segment: usize,
        low: GridPoint,
        high: GridPoint,
    }
    let mut boxes: Vec<Bounds> = segments
        .iter()
        .enumerate()
        .map(|(segment, [a, b])| Bounds {
            segment,
            low: [a[0].min(b[0]), a[1].min(b[1])],
            high: [a[0].max(b[0]), a[1].max(b[1])],
        })
        .collect();
    boxes.sort_by_key(|b| b.low[1]);
    let mut pairs = Vec::new();
    let mut active: Vec<&Bounds> = Vec::new();
    for current in &boxes {
        active.retain(|other| other.high[1] >= current.low[1]);
        for other in &active {
            if other.high[0] >= current.low[0] && current.high[0] >= other.low[0] {
                pairs.push((other.segment, current.segment));
            }
        }
        active.push(current);
    }
    pairs
}

/// How two segments meet, other than at a shared end
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Meeting {
    /// They cross at this fraction of the first
    Crossing(f64),
    /// Which ends lie within the other segment: start and end of the first, start and end of the second
    Touch([bool; 4]),
}

/// Tests two segments exactly; `None` when they are apart or meet only at shared ends
pub(crate) fn meeting([a, b]: [GridPoint; 2], [c, d]: [GridPoint; 2]) -> Option<Meeting> {
    let (oc, od) = (orientation(a, b, c), orientation(a, b, d));
    let (oa, ob) = (orientation(c, d, a), orientation(c, d, b));
    if oc.signum() * od.signum() < 0 && oa.signum() * ob.signum() < 0 {
        return Some(Meeting::Crossing(oa as f64 / (oa as f64 - ob as f64)));
    }
    let touch = [
        oa == 0 && between(c, d, a),
        ob == 0 && between(c, d, b),
        oc == 0 && between(a, b, c),
        od == 0 && between(a, b, d),
    ];
    touch.contains(&true).then_some(Meeting::Touch(touch))
}

/// Returns twice the signed area of a triangle, exactly
fn orientation(a: GridPoint, b: GridPoint, c: GridPoint) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a point on the line through `a` and `b` lies strictly between them
fn between(a: GridPoint, b: GridPoint, p: GridPoint) -> bool {
    let dot = (p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1]);
    let length = (b[0] - a[0]).pow(2) + (b[1] - a[1]).pow(2);
    dot > 0 && dot < length
}

/// Returns x where the line from `a` to `b` meets the horizontal at `y`
fn crossing_x(a: DVec2, b: DVec2, y: f64) -> f64 {
    a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loop_of(points: &[[f64; 2]]) -> Vec<DVec2> {
        points.iter().map(|&p| DVec2::from_array(p)).collect()
    }

    fn arranged(loops: &[Vec<DVec2>]) -> Arrangement {
        arrange(loops.iter().map(Vec::as_slice))
    }

    #[test]
    fn a_bow_tie_is_split_at_its_crossing() {
        let bow = loop_of(&[[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]]);
        let arrangement = arranged(&[bow]);
        assert_eq!(arrangement.points.len(), 5);
        assert_eq!(arrangement.edges.len(), 6);
        let left = Inside::new(&arrangement).winding_at(DVec2::new(0.5, 1.0));
        let right = Inside::new(&arrangement).winding_at(DVec2::new(1.5, 1.0));
        assert_eq!((left, right), (1, -1));
    }

    #[test]
    fn a_bridge_followed_in_both_directions_cancels_out() {
        let flag = loop_of(&[
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [2.0, 4.0],
            [2.0, 9.0],
            [2.0, 4.0],
            [0.0, 4.0],
        ]);
        let arrangement = arranged(&[flag]);
        assert_eq!(arrangement.edges.len(), 5);
        assert_eq!(
            Inside::new(&arrangement).winding_at(DVec2::new(1.0, 1.0)),
            1
        );
        assert_eq!(
            Inside::new(&arrangement).winding_at(DVec2::new(2.5, 6.0)),
            0
        );
        assert_eq!(arrangement.inside_spans(2.0), [(0.0, 4.0)]);
    }

    #[test]
    fn overlapping_edges_are_split_at_each_others_ends() {
        let a = loop_of(&[[0.0, 0.0], [6.0, 0.0], [6.0, 2.0], [0.0, 2.0]]);
        let b = loop_of(&[[1.0, 2.0], [4.0, 2.0], [4.0, 3.0], [1.0, 3.0]]);
        let arrangement = arranged(&[a, b]);
        // the shared part cancels: it has one edge in each direction
        assert_eq!(arrangement.edges.len(), 8);
        assert_eq!(arrangement.inside_spans(2.5), [(1.0, 4.0)]);
    }

    #[test]
    fn subdividing_keeps_the_inside() {
        let mut square = arranged(&[loop_of(&[
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [0.0, 10.0],
        ])]);
        square.subdivide(3.0);
        assert_eq!(square.edges.len(), 16);
        assert_eq!(square.inside_spans(5.0), [(0.0, 10.0)]);
    }
}
