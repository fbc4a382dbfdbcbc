//! Edges of a photo as oriented points, accurate to fractions of a pixel.

use glam::DVec2;
use pirouette_geom::Grid;

use crate::scan::Photo;

/// A point of an edge
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgePoint {
    /// Photo coordinates, on the edge
    pub(super) position: DVec2,
    /// Unit normal, toward the brighter side
    pub(super) normal: DVec2,
}

/// Gradients below this many gray levels per px are noise
const MIN_GRADIENT: f32 = 5.0;

/// Finds the points of all edges
pub(super) fn edge_points(photo: &Photo) -> Vec<EdgePoint> {
    let (width, height) = (photo.width(), photo.height());
    if width < 8 || height < 8 {
        return Vec::new();
    }
    // The strongest of the three channels decides: a blue card in front of an equally bright wall has an edge, too.
    let channels: Vec<Grid<f32>> = (0..3)
        .map(|c| smooth(&photo.map(|p| f32::from(p[c]))))
        .collect();
    let gradient = |x: usize, y: usize| {
        let of = |g: &Grid<f32>| {
            let dx = (g[(x + 1, y)] - g[(x - 1, y)]) / 2.0;
            let dy = (g[(x, y + 1)] - g[(x, y - 1)]) / 2.0;
            [dx, dy]
        };
        let all = channels.iter().map(of);
        all.max_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])))
            .unwrap_or([0.0; 2])
    };
    let gradients = Grid::from_fn(width, height, |x, y| {
        if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
            [0.0; 2]
        } else {
            gradient(x, y)
        }
    });
    let size = |x: isize, y: isize| gradients.get(x, y).map_or(0.0, |g| g[0].hypot(g[1]));
    let mut points = Vec::new();
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let g = gradients[(x, y)];
            let here = g[0].hypot(g[1]);
            if here < MIN_GRADIENT {
                continue;
            }
            // Only the crest of an edge counts, along the larger component of its normal.
            let along = if g[0].abs() >= g[1].abs() {
                (g[0].signum() as isize, 0)
            } else {
                (0, g[1].signum() as isize)
            };
            let (x0, y0) = (x as isize, y as isize);
            let before = size(x0 - along.0, y0 - along.1);
            let after = size(x0 + along.0, y0 + along.1);
            if here < before || here <= after {
                continue;
            }
            let bend = before - 2.0 * here + after;
            let offset = if bend < 0.0 {
                f64::from((before - after) / (2.0 * bend)).clamp(-0.5, 0.5)
            } else {
                0.0
            };
            let step = DVec2::new(along.0 as f64, along.1 as f64);
            points.push(EdgePoint {
                position: DVec2::new(x as f64 + 0.5, y as f64 + 0.5) + step * offset,
                normal: DVec2::new(f64::from(g[0]), f64::from(g[1])) / f64::from(here),
            });
        }
    }
    points
}

/// Smooths with the neighbors: binomial, three by three, twice
fn smooth(channel: &Grid<f32>) -> Grid<f32> {
    let pass = |grid: &Grid<f32>, dx: isize, dy: isize| {
        Grid::from_fn(grid.width(), grid.height(), |x, y| {
            let (x, y) = (x as isize, y as isize);
            let here = *grid.get(x, y).unwrap_or(&0.0);
            let near = |s: isize| *grid.get(x + s * dx, y + s * dy).unwrap_or(&here);
            0.25 * near(-1) + 0.5 * here + 0.25 * near(1)
        })
    };
    let once = pass(&pass(channel, 1, 0), 0, 1);
    pass(&pass(&once, 1, 0), 0, 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_of_a_half_plane_is_located_exactly() {
        // Bright from x = 20.3 on, covered partly in between.
        let photo = Photo::from_fn(40, 30, |x, _| {
            let covered = (x as f64 + 1.0 - 20.3).clamp(0.0, 1.0);
            [(40.0 + 150.0 * covered) as u8; 3]
        });
        let points = edge_points(&photo);
        assert!(points.len() >= 26);
        for point in &points {
            assert!((point.position.x - 20.3).abs() < 0.1, "{point:?}");
            assert!((point.normal - DVec2::X).length() < 0.05, "{point:?}");
        }
    }

    #[test]
    fn a_plain_or_tiny_photo_has_no_edges() {
        assert!(edge_points(&Photo::filled(30, 30, [90; 3])).is_empty());
        assert!(edge_points(&Photo::filled(3, 30, [90; 3])).is_empty());
    }
}
