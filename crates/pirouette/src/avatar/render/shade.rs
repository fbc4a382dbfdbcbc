//! Shaded pictures of a surface.

use glam::DVec3;
use pirouette_geom::{Grid, TriMesh};
use rayon::prelude::*;

use super::depth::{NearestSurface, nearest_surface, project_with_depth};
use super::silhouette;
use crate::camera::Camera;
use crate::scan::Photo;

/// Samples per pixel along each axis for the colors inside; the outline itself is exact
const SAMPLES: usize = 2;

/// Linear color of a surface that comes without colors: warm light clay
const CLAY: [f32; 3] = [0.62, 0.52, 0.45];

/// Background at the top and at the bottom, as stored in files
const BACKGROUND: [[f32; 3]; 2] = [[244.0, 246.0, 249.0], [221.0, 225.0, 231.0]];

/// A picture of a surface alone, to be laid over another
#[derive(Debug, Clone)]
pub struct Layer {
    /// Linear light, 0 to 1; meaningful where `coverage` is above 0
    pub color: Grid<[f32; 3]>,
    /// Area of the pixel that the surface covers, 0 to 1
    pub coverage: Grid<f32>,
}

/// Draws a surface with smooth shading before a light background
///
/// `colors` are linear RGB, one per vertex; clay without. Normals are the area-weighted means of the triangles'.
///
/// # Panics
/// When a triangle names a vertex that does not exist, or there are colors for some vertices only.
pub fn shade(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    colors: Option<&[[f32; 3]]>,
    camera: &Camera,
) -> Photo {
    let layer = shade_layer(positions, triangles, camera, |_, _, albedo| albedo, colors);
    let height = camera.height_px.max(2) as f32 - 1.0;
    Photo::from_fn(camera.width_px, camera.height_px, |x, y| {
        let (alpha, t) = (layer.coverage[(x, y)], y as f32 / height);
        let color = layer.color[(x, y)];
        std::array::from_fn(|k| {
            let behind = BACKGROUND[0][k] * (1.0 - t) + BACKGROUND[1][k] * t;
            let mixed = linear_from_srgb(behind / 255.0) * (1.0 - alpha) + color[k] * alpha;
            (srgb_from_linear(mixed) * 255.0 + 0.5) as u8
        })
    })
}

/// Draws a surface into a layer; `paint` gives the linear color of a point from the room position, the unit
/// normal and the color interpolated between the vertices
///
/// # Panics
/// When a triangle names a vertex that does not exist, or there are colors for some vertices only.
pub fn shade_layer(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    camera: &Camera,
    paint: impl Fn(DVec3, DVec3, [f32; 3]) -> [f32; 3] + Sync,
    colors: Option<&[[f32; 3]]>,
) -> Layer {
    if let Some(colors) = colors {
        assert_eq!(colors.len(), positions.len(), "one color per vertex");
    }
    let fine = Camera {
        width_px: camera.width_px * SAMPLES,
        height_px: camera.height_px * SAMPLES,
        ..*camera
    };
    let mesh = TriMesh {
        positions: positions.to_vec(),
        triangles: triangles.to_vec(),
    };
    let normals = mesh.vertex_normals();
    let surface = nearest_surface(positions, triangles, &fine);
    let projected = project_with_depth(positions, &fine);
    let lights = Lights::for_camera(camera);

    let sample = |x: usize, y: usize| -> Option<[f32; 3]> {
        let t = surface.triangle[(x, y)];
        if t == NearestSurface::NONE {
            return None;
        }
        let triangle = triangles[t as usize];
        let [a, b, c] = triangle.map(|v| projected[v as usize]);
        let (a, b, c) = (a?, b?, c?);
        let p = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a.0;
        let area = (b.0 - a.0).perp_dot(c.0 - a.0);
        let wb = p.perp_dot(c.0 - a.0) / area;
        let wc = (b.0 - a.0).perp_dot(p) / area;
        // perspective-correct weights
        let raw = [(1.0 - wb - wc) / a.1, wb / b.1, wc / c.1];
        let sum: f64 = raw.iter().sum();
        let weights = raw.map(|w| w / sum);
        let blend = |of: &[DVec3]| -> DVec3 {
            triangle
                .iter()
                .zip(weights)
                .map(|(&v, w)| of[v as usize] * w)
                .sum()
        };
        let point = blend(positions);
        let normal = blend(&normals).try_normalize().unwrap_or(DVec3::Z);
        let mut albedo = CLAY;
        if let Some(colors) = colors {
            albedo = [0.0; 3];
            for (&v, w) in triangle.iter().zip(weights) {
                for (channel, value) in albedo.iter_mut().zip(colors[v as usize]) {
                    *channel += value * w as f32;
                }
            }
        }
        Some(lights.on(point, normal, paint(point, normal, albedo)))
    };

    let coverage = silhouette(positions, triangles, camera);
    let (width, height) = (camera.width_px, camera.height_px);
    let rows: Vec<Vec<Option<[f32; 3]>>> = (0..height)
        .into_par_iter()
        .map(|y| {
            (0..width)
                .map(|x| {
                    let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
                    for k in 0..SAMPLES * SAMPLES {
                        let at = (x * SAMPLES + k % SAMPLES, y * SAMPLES + k / SAMPLES);
                        if let Some(color) = sample(at.0, at.1) {
                            sum = std::array::from_fn(|i| sum[i] + color[i]);
                            count += 1.0;
                        }
                    }
                    (count > 0.0).then(|| sum.map(|v| v / count))
                })
                .collect()
        })
        .collect();
    let sampled = Grid::from_vec(width, height, rows.into_iter().flatten().collect());
    // A pixel that the outline only grazes has no sample: it takes its neighbors' color.
    let color = Grid::from_fn(width, height, |x, y| {
        if let Some(color) = sampled[(x, y)] {
            return color;
        }
        if coverage[(x, y)] <= 0.0 {
            return [0.0; 3];
        }
        let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
        for k in 0..9 {
            let at = (x as isize + k % 3 - 1, y as isize + k / 3 - 1);
            if let Some(Some(color)) = sampled.get(at.0, at.1) {
                sum = std::array::from_fn(|i| sum[i] + color[i]);
                count += 1.0;
            }
        }
        sum.map(|v| v / count.max(1.0))
    });
    Layer { color, coverage }
}

/// A soft studio: light from beside the camera, from the upper left, and from the whole sky
struct Lights {
    eye: DVec3,
    key: DVec3,
}

impl Lights {
    const HEAD: f64 = 0.35;
    const KEY: f64 = 0.55;
    const SKY: f64 = 0.42;
    const GROUND: f64 = 0.16;
    /// Gloss of skin and clay: faint and broad
    const GLOSS: f64 = 0.05;
    const GLOSS_POWER: f64 = 18.0;

    fn for_camera(camera: &Camera) -> Self {
        Self {
            eye: camera.center(),
            key: DVec3::new(-0.55, 0.65, 0.6).normalize_or(DVec3::Z),
        }
    }

    fn on(&self, point: DVec3, normal: DVec3, albedo: [f32; 3]) -> [f32; 3] {
        let to_eye = (self.eye - point).normalize_or(DVec3::Z);
        let head = normal.dot(to_eye).max(0.0);
        // wrapped, so that the shadow side fades gently
        let key = ((normal.dot(self.key) + 0.25) / 1.25).max(0.0);
        let sky = Self::GROUND + (Self::SKY - Self::GROUND) * (0.5 + 0.5 * normal.y);
        let light = Self::HEAD * head + Self::KEY * key + sky;
        let half = (to_eye + self.key).normalize_or(DVec3::Z);
        let gloss = Self::GLOSS * normal.dot(half).max(0.0).powf(Self::GLOSS_POWER);
        albedo.map(|a| (a * light as f32 + gloss as f32).clamp(0.0, 1.0))
    }
}

/// sRGB value (0 to 1) of a linear one
pub(crate) fn srgb_from_linear(linear: f32) -> f32 {
    let v = linear.clamp(0.0, 1.0);
    if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    }
}

/// Linear value of an sRGB one (0 to 1)
pub(crate) fn linear_from_srgb(srgb: f32) -> f32 {
    let v = srgb.clamp(0.0, 1.0);
    if v <= 0.040_45 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{camera, sphere};
    use super::*;

    #[test]
    fn a_ball_is_lit_from_the_front_and_keeps_the_background_light() {
        let (positions, triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 300.0, 24);
        let photo = shade(&positions, &triangles, None, &camera());
        let luma = |x: usize, y: usize| photo[(x, y)].iter().map(|&v| u32::from(v)).sum::<u32>();
        assert!(luma(2, 2) > 3 * 235);
        assert!(luma(80, 100) < luma(2, 2));
        // the upper left is brighter than the lower right
        assert!(luma(68, 85) > luma(92, 115));
    }

    #[test]
    fn colors_of_the_vertices_show() {
        let (positions, triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 300.0, 24);
        let red = vec![[0.8, 0.05, 0.05]; positions.len()];
        let photo = shade(&positions, &triangles, Some(&red), &camera());
        let [r, g, _] = photo[(80, 100)];
        assert!(r > g + 80);
    }

    #[test]
    fn sample_count_does_not_move_the_outline() {
        let (positions, triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 300.0, 24);
        let layer = shade_layer(&positions, &triangles, &camera(), |_, _, a| a, None);
        assert_eq!(
            layer.coverage,
            silhouette(&positions, &triangles, &camera())
        );
        let unlit = layer
            .color
            .as_slice()
            .iter()
            .zip(layer.coverage.as_slice())
            .filter(|(color, coverage)| **coverage > 0.01 && color[0] <= 0.0)
            .count();
        assert_eq!(unlit, 0);
    }

    #[test]
    fn srgb_goes_in_and_out() {
        for i in 0..=20 {
            let v = i as f32 / 20.0;
            assert!((linear_from_srgb(srgb_from_linear(v)) - v).abs() < 1e-5);
        }
    }
}
