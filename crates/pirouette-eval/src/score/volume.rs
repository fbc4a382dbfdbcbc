//! Common volume of two bodies.

use glam::DVec3;
use pirouette_geom::TriMesh;
use rayon::prelude::*;

use super::surface::Aligned;

/// Distance of the lines along which volumes are compared, in mm
const LINE_SPACING_MM: f64 = 6.0;

/// Computes the intersection over union of the volumes of two bodies, after a shift and a turn about the vertical
///
/// Both bodies are cut by vertical lines 6 mm apart; along each the inside lengths are exact. `None` if one has no
/// surface. The alignment is that of [`super::surface::surface_error`].
pub fn volume_iou(body: &TriMesh, truth: &TriMesh) -> Option<f64> {
    let aligned = Aligned::new(body, truth)?;
    iou_in_place(&aligned.body, &aligned.truth)
}

/// Computes the intersection over union without alignment
fn iou_in_place(a: &TriMesh, b: &TriMesh) -> Option<f64> {
    let (low, high) = (a.bounds()?, b.bounds()?);
    let (low, high) = (low.0.min(high.0), low.1.max(high.1));
    let size = ((high - low) / LINE_SPACING_MM).ceil();
    // Offset from round coordinates, which vertices often have, so that lines do not pass through edges.
    let start = low + LINE_SPACING_MM * DVec3::new(0.4871, 0.0, 0.5113);
    let lines = |mesh: &TriMesh| Lines::cut(mesh, start, size.x as usize, size.z as usize);
    let (a, b) = rayon::join(|| lines(a), || lines(b));
    let (both, either) = (a.crossings.par_iter().zip(&b.crossings))
        .map(|(a, b)| {
            let both = common_length(a, b);
            (both, inside_length(a) + inside_length(b) - both)
        })
        .reduce(|| (0.0, 0.0), |x, y| (x.0 + y.0, x.1 + y.1));
    (either > 0.0).then(|| both / either)
}

/// Sorted heights at which each vertical line crosses the surface
struct Lines {
    crossings: Vec<Vec<f64>>,
}

impl Lines {
    fn cut(mesh: &TriMesh, start: DVec3, columns: usize, rows: usize) -> Self {
        let mut crossings = vec![Vec::new(); columns * rows];
        for t in 0..mesh.triangles.len() {
            let corners = mesh.corners(t).map(|p| (p - start) / LINE_SPACING_MM);
            let [a, b, c] = corners;
            let low = a.min(b).min(c).max(DVec3::ZERO);
            let high = a.max(b).max(c);
            let area = (b.x - a.x) * (c.z - a.z) - (c.x - a.x) * (b.z - a.z);
            if area == 0.0 || !area.is_finite() || high.x < 0.0 || high.z < 0.0 {
                continue;
            }
            let last = |high: f64, count: usize| (high.floor() as usize + 1).min(count);
            for i in low.x.ceil() as usize..last(high.x, columns) {
                for k in low.z.ceil() as usize..last(high.z, rows) {
                    let (x, z) = (i as f64, k as f64);
                    let part =
                        |p: DVec3, q: DVec3| ((p.x - x) * (q.z - z) - (q.x - x) * (p.z - z)) / area;
                    let (u, v, w) = (part(b, c), part(c, a), part(a, b));
                    if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                        let y = u * a.y + v * b.y + w * c.y;
                        crossings[k * columns + i].push(y * LINE_SPACING_MM);
                    }
                }
            }
        }
        for line in &mut crossings {
            line.sort_by(f64::total_cmp);
        }
        Self { crossings }
    }
}

fn inside_length(line: &[f64]) -> f64 {
    line.chunks_exact(2).map(|span| span[1] - span[0]).sum()
}

fn common_length(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = 0.0;
    for one in a.chunks_exact(2) {
        for other in b.chunks_exact(2) {
            sum += (one[1].min(other[1]) - one[0].max(other[0])).max(0.0);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(low: DVec3, high: DVec3) -> TriMesh {
        let corner = |i: u32| {
            let pick = |bit: u32, l: f64, h: f64| if i >> bit & 1 == 1 { h } else { l };
            DVec3::new(
                pick(0, low.x, high.x),
                pick(1, low.y, high.y),
                pick(2, low.z, high.z),
            )
        };
        let quads = [
            [0, 4, 6, 2],
            [1, 3, 7, 5],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 2, 3, 1],
            [4, 5, 7, 6],
        ];
        TriMesh {
            positions: (0..8).map(corner).collect(),
            triangles: quads
                .iter()
                .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
                .collect(),
        }
    }

    #[test]
    fn common_volumes_of_blocks_are_exact() {
        let a = block(DVec3::ZERO, DVec3::new(300.0, 600.0, 300.0));
        let b = block(DVec3::new(0.0, 200.0, 0.0), DVec3::new(300.0, 800.0, 300.0));
        let c = block(DVec3::splat(1000.0), DVec3::splat(1200.0));
        let close = |found: Option<f64>, expected: f64| {
            assert!((found.unwrap() - expected).abs() < 1e-3, "{found:?}");
        };
        close(iou_in_place(&a, &a), 1.0);
        close(iou_in_place(&a, &b), 0.5);
        close(iou_in_place(&a, &c), 0.0);
        let nothing = TriMesh {
            positions: Vec::new(),
            triangles: Vec::new(),
        };
        assert_eq!(volume_iou(&a, &nothing), None);
    }
}
