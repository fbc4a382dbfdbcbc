//! Distortion of the lens, by the edges of the room: most of them are straight, and bent in the photos of a wide lens.
//!
//! The room is what does not change while the person turns. Long edges are traced in it; each of them has a coefficient
//! of distortion that makes it straight, and those of straight edges agree.
//!
//! # Source
//! Devernay and Faugeras 2001, "Straight lines have to be straight". Instead of all edges together, each is solved by
//! itself, so that edges of round things are recognized by their disagreement.

use glam::DVec2;
use pirouette_geom::Grid;
use pirouette_geom::parallel::prelude::*;

use crate::scan::{Photo, View};

/// Number of photos that the room is the median of
const PHOTOS: usize = 5;

/// Largest difference of the gray levels of a static pixel in these photos
///
/// Outlines of the person differ by more, at least on their outer side.
const MAX_CHANGE: f32 = 24.0;

/// Smallest coefficient that is corrected: the usual standard deviations contain smaller ones
const MIN_COEFFICIENT: f64 = 0.02;

/// Coefficients of lenses; beyond them are fisheyes, and edges of round things
const COEFFICIENTS: std::ops::RangeInclusive<f64> = -0.1..=0.4;

/// Smallest difference of gray levels over two pixels at an edge
const MIN_SLOPE: f32 = 8.0;

/// Smallest length of an edge, as a share of the photo's height
const MIN_LENGTH: f64 = 0.12;

/// Largest distance of an edge from its curve, root mean square, in px
const MAX_ROUGHNESS_PX: f64 = 0.8;

/// Uncertainty of the curvature of an edge, as that of the position of a point, in px; errors of neighbors are alike
const POINT_SIGMA_PX: f64 = 0.7;

/// Standard deviation of the coefficient of an edge above which it says too little
const MAX_SIGMA: f64 = 0.04;

/// Difference of the coefficients of two straight edges; of edges of the rendered rooms: 0.002
const SPREAD: f64 = 0.005;

/// Smallest number of edges that agree, and their smallest share of the weight of all
const MIN_EDGES: usize = 3;
const MIN_AGREEMENT: f64 = 0.5;

/// Returns the coefficient of distortion of [`pirouette_body::lens::Lens`] if the edges of the room clearly show one
pub(super) fn find_distortion(views: &[View]) -> Option<f64> {
    distortion_of(&static_room(views)?)
}

fn distortion_of(room: &Grid<f32>) -> Option<f64> {
    let across = Grid::from_fn(room.height(), room.width(), |x, y| room[(y, x)]);
    let size = DVec2::new(room.width() as f64, room.height() as f64);
    let mut edges = upright_edges(room);
    let level = upright_edges(&across).into_iter();
    edges.extend(level.map(|edge| edge.iter().map(|p| DVec2::new(p.y, p.x)).collect()));
    let found: Vec<Straightening> = edges
        .iter()
        .filter(|edge| edge.len() as f64 > MIN_LENGTH * size.y)
        .filter_map(|edge| straighten(edge, size))
        .collect();
    agreement(&found)
}

/// Returns the gray levels of the room, the median of photos of one size; NaN where they differ
fn static_room(views: &[View]) -> Option<Grid<f32>> {
    let first = &views.first()?.photo;
    let alike = views.iter().all(|view| view.photo.same_size(first));
    let step = views.len() as f64 / PHOTOS as f64;
    if !alike || step < 1.0 || first.width() < 3 || first.height() < 3 {
        return None;
    }
    let photos: Vec<&Photo> = (0..PHOTOS)
        .map(|i| &views[(i as f64 * step) as usize].photo)
        .collect();
    let gray = |color: [u8; 3]| color.iter().map(|&v| f32::from(v)).sum::<f32>() / 3.0;
    let rows: Vec<Vec<f32>> = (0..first.height())
        .into_par_iter()
        .map(|y| {
            let level = |x: usize| {
                let mut levels: [f32; PHOTOS] = std::array::from_fn(|i| gray(photos[i][(x, y)]));
                levels.sort_unstable_by(f32::total_cmp);
                let same = levels[PHOTOS - 1] - levels[0] < MAX_CHANGE;
                if same { levels[PHOTOS / 2] } else { f32::NAN }
            };
            (0..first.width()).map(level).collect()
        })
        .collect();
    Some(Grid::from_fn(first.width(), first.height(), |x, y| {
        rows[y][x]
    }))
}

/// Traces edges that are nearer to upright than to level, from top to bottom; points in px
fn upright_edges(room: &Grid<f32>) -> Vec<Vec<DVec2>> {
    let (width, height) = (room.width(), room.height());
    // Differences over two columns, of the mean of three rows
    let slope = |x: usize, y: usize| -> f32 {
        (y - 1..=y + 1)
            .map(|y| room[(x + 1, y)] - room[(x - 1, y)])
            .sum::<f32>()
            / 3.0
    };
    let rows: Vec<Vec<f32>> = (0..height)
        .into_par_iter()
        .map(|y| {
            let inner = |x: usize| x > 0 && x + 1 < width && y > 0 && y + 1 < height;
            (0..width)
                .map(|x| if inner(x) { slope(x, y) } else { 0.0 })
                .collect()
        })
        .collect();
    // Columns of the steepest slopes of each row, with their signs
    let crests: Vec<Vec<(f64, bool)>> = rows
        .par_iter()
        .map(|row| {
            let crest = |x: usize| {
                let [before, at, after] = [row[x - 1], row[x], row[x + 1]].map(f32::abs);
                let steepest = at > MIN_SLOPE && at > before && at >= after;
                steepest.then(|| {
                    let bend = before + after - 2.0 * at;
                    let offset = 0.5 * (before - after) / bend;
                    (x as f64 + 0.5 + f64::from(offset), row[x] > 0.0)
                })
            };
            (1..width - 1).filter_map(crest).collect()
        })
        .collect();
    linked(&crests)
}

/// Links the crests of neighboring rows
fn linked(crests: &[Vec<(f64, bool)>]) -> Vec<Vec<DVec2>> {
    /// Largest sideways step from one row to the next, in px
    const MAX_STEP_PX: f64 = 1.2;
    let mut finished = Vec::new();
    let mut open: Vec<(Vec<DVec2>, bool)> = Vec::new();
    for (y, row) in crests.iter().enumerate() {
        let mut taken = vec![false; row.len()];
        let (mut still_open, mut next) = (Vec::with_capacity(row.len()), 0);
        for (mut edge, rises) in open {
            let last = edge[edge.len() - 1].x;
            while next < row.len() && row[next].0 < last - MAX_STEP_PX {
                next += 1;
            }
            let near = (next..row.len())
                .take_while(|&i| row[i].0 <= last + MAX_STEP_PX)
                .filter(|&i| row[i].1 == rises && !taken[i])
                .min_by(|&a, &b| (row[a].0 - last).abs().total_cmp(&(row[b].0 - last).abs()));
            match near {
                Some(i) => {
                    taken[i] = true;
                    edge.push(DVec2::new(row[i].0, y as f64 + 0.5));
                    still_open.push((edge, rises));
                }
                None => finished.push(edge),
            }
        }
        let new = row.iter().zip(&taken).filter(|&(_, &taken)| !taken);
        still_open.extend(new.map(|(&(x, rises), _)| (vec![DVec2::new(x, y as f64 + 0.5)], rises)));
        still_open.sort_by(|a, b| a.0[a.0.len() - 1].x.total_cmp(&b.0[b.0.len() - 1].x));
        open = still_open;
    }
    finished.extend(open.into_iter().map(|(edge, _)| edge));
    finished
}

/// The coefficient that makes an edge straight
#[derive(Debug, Clone, Copy, PartialEq)]
struct Straightening {
    coefficient: f64,
    sigma: f64,
}

impl Straightening {
    fn weight(&self) -> f64 {
        1.0 / (self.sigma * self.sigma + SPREAD * SPREAD)
    }
}

/// Solves for the coefficient that makes an edge straight; `None` if no lens has it, or the edge is rough or says too
/// little
///
/// With points `(t, s)` along and across the edge, relative to the middle of the photo, and `r` the distance from it: the
/// straight edge is `s (1 + k r²) = a + b t (1 + k r²)`, hence `s = a + b t - k r² (s - b t)`.
fn straighten(edge: &[DVec2], size: DVec2) -> Option<Straightening> {
    let half_height = size.y / 2.0;
    let points: Vec<DVec2> = edge
        .iter()
        .map(|p| (*p - size / 2.0) / half_height)
        .collect();
    let count = points.len() as f64;
    let mean = points.iter().sum::<DVec2>() / count;
    let spread = points
        .iter()
        .map(|p| (*p - mean) * (*p - mean))
        .sum::<DVec2>();
    let upright = spread.y > spread.x;
    let (t, s): (Vec<f64>, Vec<f64>) = points
        .iter()
        .map(|p| if upright { (p.y, p.x) } else { (p.x, p.y) })
        .unzip();
    let (offsets, slope) = without_line(&t, &s)?;
    let bent = t.iter().zip(&s).zip(&points);
    let bend: Vec<f64> = bent
        .map(|((t, s), p)| -p.length_squared() * (s - slope * t))
        .collect();
    let (bend, _) = without_line(&t, &bend)?;
    let square: f64 = bend.iter().map(|b| b * b).sum();
    let product: f64 = bend.iter().zip(&offsets).map(|(b, o)| b * o).sum();
    let sigma = POINT_SIGMA_PX / half_height / square.sqrt();
    if sigma.is_nan() || sigma > MAX_SIGMA {
        return None;
    }
    let coefficient = product / square;
    let rest = bend
        .iter()
        .zip(&offsets)
        .map(|(b, o)| (o - coefficient * b).powi(2));
    let rough_px = half_height * (rest.sum::<f64>() / count).sqrt();
    let plausible = rough_px < MAX_ROUGHNESS_PX && COEFFICIENTS.contains(&coefficient);
    plausible.then_some(Straightening { coefficient, sigma })
}

/// Subtracts the line of least squares from values over positions; returns the rest, and the slope of the line
fn without_line(positions: &[f64], values: &[f64]) -> Option<(Vec<f64>, f64)> {
    let count = positions.len() as f64;
    let mean = |of: &[f64]| of.iter().sum::<f64>() / count;
    let (middle, level) = (mean(positions), mean(values));
    let square: f64 = positions.iter().map(|t| (t - middle).powi(2)).sum();
    let both = || positions.iter().zip(values);
    let slope = both().map(|(t, v)| (t - middle) * (v - level)).sum::<f64>() / square;
    let rest = both().map(|(t, v)| v - level - slope * (t - middle));
    slope.is_finite().then(|| (rest.collect(), slope))
}

/// Returns the coefficient that most edges agree on, if it is worth a correction
fn agreement(edges: &[Straightening]) -> Option<f64> {
    let total: f64 = edges.iter().map(Straightening::weight).sum();
    let agreeing = |middle: &Straightening| -> Vec<Straightening> {
        let near = |edge: &&Straightening| {
            let difference = (edge.coefficient - middle.coefficient).abs();
            difference < 2.0 * edge.sigma.hypot(SPREAD)
        };
        edges.iter().filter(near).copied().collect()
    };
    let weight = |edges: &[Straightening]| edges.iter().map(Straightening::weight).sum::<f64>();
    let most = edges
        .iter()
        .map(agreeing)
        .max_by(|a, b| weight(a).total_cmp(&weight(b)))?;
    let sum: f64 = most.iter().map(|e| e.weight() * e.coefficient).sum();
    let coefficient = sum / weight(&most);
    let clear = most.len() >= MIN_EDGES && weight(&most) >= MIN_AGREEMENT * total;
    (clear && coefficient.abs() >= MIN_COEFFICIENT).then_some(coefficient)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::lens::Lens;

    /// Returns a photo of a room that a lens bends; `level` is the gray level at a position relative to the middle, in px
    fn photographed(coefficient: f64, level: impl Fn(DVec2) -> f64) -> Grid<f32> {
        let (width, height) = (240, 300);
        let lens = Lens {
            coefficient,
            half_height_px: height as f64 / 2.0,
        };
        let middle = DVec2::new(width as f64, height as f64) / 2.0;
        Grid::from_fn(width, height, |x, y| {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - middle;
            level(lens.straighten(at)) as f32
        })
    }

    /// Returns the gray level of a wall with slanted stripes
    fn stripes(at: DVec2) -> f64 {
        let across = (at.x + 0.1 * at.y) / 12.0;
        120.0 + 60.0 * (8.0 * across.sin()).tanh()
    }

    #[test]
    fn the_bent_stripes_of_a_wall_show_the_distortion() {
        for coefficient in [-0.06, 0.03, 0.08, 0.2] {
            let found = distortion_of(&photographed(coefficient, stripes)).unwrap();
            assert!(
                (found - coefficient).abs() < 0.003,
                "{coefficient}: {found}"
            );
        }
    }

    #[test]
    fn straight_stripes_and_a_plain_wall_show_none() {
        assert_eq!(distortion_of(&photographed(0.0, stripes)), None);
        assert_eq!(distortion_of(&photographed(0.0, |_| 120.0)), None);
    }

    #[test]
    fn round_things_are_no_distortion() {
        // Rings around several centers: each edge has a coefficient of its own.
        let rings = |at: DVec2| {
            let center = DVec2::new(300.0 * at.x.signum(), 200.0 * at.y.signum());
            120.0 + 60.0 * (8.0 * (at.distance(center) / 15.0).sin()).tanh()
        };
        assert_eq!(distortion_of(&photographed(0.0, rings)), None);
    }

    #[test]
    fn what_changes_between_photos_is_no_edge_of_the_room() {
        let mut room = photographed(0.08, stripes);
        let (width, height) = (room.width(), room.height());
        for y in 0..height {
            for x in 0..width {
                room[(x, y)] = f32::NAN;
            }
        }
        assert_eq!(distortion_of(&room), None);
    }

    #[test]
    fn the_coefficient_of_most_edges_counts() {
        let edge = |coefficient: f64, sigma: f64| Straightening { coefficient, sigma };
        let three = [0.08, 0.081, 0.079].map(|k| edge(k, 0.002));
        let found = |more: &[Straightening]| agreement(&[&three[..], more].concat());
        assert!((found(&[]).unwrap() - 0.08).abs() < 1e-3);
        assert!((found(&[edge(-0.05, 0.004), edge(0.2, 0.03)]).unwrap() - 0.08).abs() < 1e-3);
        // More than half of the weight disagrees.
        let others = [-0.09, -0.05, 0.2, 0.25, 0.3].map(|k| edge(k, 0.002));
        assert_eq!(found(&others), None);
        assert_eq!(agreement(&three[..2]), None);
        assert_eq!(
            agreement(&[0.001, 0.002, 0.0].map(|k| edge(k, 0.002))),
            None
        );
        assert_eq!(agreement(&[]), None);
    }
}
