//! Shaded pictures of a surface.

use std::sync::LazyLock;

use glam::{DVec2, DVec3};
use pirouette_geom::Grid;
use pirouette_geom::parallel::prelude::*;

use super::SilhouetteMesh;
use super::depth::{DepthBuffer, NearestSurface, Seen, drawn_triangles, see_all};
use crate::Camera;

/// Samples per pixel along each axis for the colors inside; the outline itself is exact
const SAMPLES: usize = 2;

/// Number of pixel rows drawn at once: their samples fit into the cache
const BAND_ROWS: usize = 32;

/// Linear color of a surface without colors: warm light clay
const CLAY: [f32; 3] = [0.50, 0.395, 0.33];

/// Background at the top and at the bottom, as stored in files
const BACKGROUND: [[f32; 3]; 2] = [[244.0, 246.0, 249.0], [221.0, 225.0, 231.0]];

/// A picture of a surface alone, to be composited over another
#[derive(Debug, Clone)]
pub struct Layer {
    /// Linear light, 0 to 1; meaningful where `coverage` is above 0
    pub color: Grid<[f32; 3]>,
    /// Area of the pixel that the surface covers, 0 to 1
    pub coverage: Grid<f32>,
}

/// Draws a surface with smooth shading in front of a light background
///
/// `colors` are linear RGB, one per vertex; clay if absent. Normals are the area-weighted means of the triangle
/// normals. The outline is resolved by four samples per pixel.
///
/// # Panics
/// When a triangle refers to a vertex that does not exist, or the number of colors differs from the number of vertices.
pub fn shade(
    mesh: &SilhouetteMesh,
    positions: &[DVec3],
    colors: Option<&[[f32; 3]]>,
    camera: &Camera,
) -> Grid<[u8; 3]> {
    check_colors(colors, positions);
    let (width, height) = (camera.width_px, camera.height_px);
    let mut photo = Grid::filled(width, height, [0; 3]);
    let behind = |y: usize| -> [f32; 3] {
        let t = y as f32 / (height.max(2) - 1) as f32;
        std::array::from_fn(|k| BACKGROUND[0][k] * (1.0 - t) + BACKGROUND[1][k] * t)
    };
    for y in 0..height {
        photo.row_mut(y).fill(behind(y).map(|v| (v + 0.5) as u8));
    }
    let Some(scene) = Scene::new(positions, mesh, camera) else {
        return photo;
    };
    // Colors hardly change between neighboring vertices: lighting is computed only at these.
    let lights = Lights::new();
    let lit = |(v, normal)| lights.on(normal, colors.map_or(CLAY, |colors| colors[v]));
    let normals = vertex_normals(positions, mesh.triangles());
    let lit: Vec<[f32; 3]> = normals.into_iter().enumerate().map(lit).collect();
    let color_at = |(triangle, weights): ([u32; 3], [f64; 3])| {
        let mut color = [0.0; 3];
        for (&v, w) in triangle.iter().zip(weights) {
            for (channel, value) in color.iter_mut().zip(lit[v as usize]) {
                *channel += value * w as f32;
            }
        }
        color
    };
    let draw_row = |samples: &Samples, y: usize, row: &mut [[u8; 3]]| {
        let window = &samples.window;
        let linear = behind(window.y + y).map(|v| linear_from_srgb(v / 255.0));
        let row = &mut row[window.x..window.x + window.width];
        for (x, pixel) in row.iter_mut().enumerate() {
            let (color, share) = if samples.one_surface(x, y) {
                match samples.at_center(x, y) {
                    Some(place) => (color_at(place), 1.0),
                    None => continue,
                }
            } else {
                let found = samples.of_pixel(x, y).map(color_at);
                let Some((color, count)) = mean(found) else {
                    continue;
                };
                (color, count / (SAMPLES * SAMPLES) as f32)
            };
            *pixel = std::array::from_fn(|k| {
                level_from_linear(linear[k] * (1.0 - share) + color[k] * share)
            });
        }
    };
    let rows = scene.window.y * width..(scene.window.y + scene.window.height) * width;
    photo.as_mut_slice()[rows]
        .par_chunks_mut(width * BAND_ROWS)
        .enumerate()
        .for_each(|(band, rows)| {
            let samples = scene.band(band);
            for (y, row) in rows.chunks_mut(width).enumerate() {
                draw_row(&samples, y, row);
            }
        });
    photo
}

fn check_colors(colors: Option<&[[f32; 3]]>, positions: &[DVec3]) {
    if let Some(colors) = colors {
        assert_eq!(colors.len(), positions.len(), "one color per vertex");
    }
}

/// Draws a surface into a layer; `paint` returns the linear color of a point given the color interpolated between the
/// vertices
///
/// The coverage is exact; colors are sampled at four points per pixel.
///
/// # Panics
/// When a triangle refers to a vertex that does not exist, or the number of colors differs from the number of vertices.
pub fn shade_layer(
    mesh: &SilhouetteMesh,
    positions: &[DVec3],
    camera: &Camera,
    paint: impl Fn([f32; 3]) -> [f32; 3] + Sync,
    colors: Option<&[[f32; 3]]>,
) -> Layer {
    check_colors(colors, positions);
    let (width, height) = (camera.width_px, camera.height_px);
    let mut layer = Layer {
        color: Grid::filled(width, height, [0.0; 3]),
        coverage: mesh.silhouette(positions, camera),
    };
    let Some(scene) = Scene::new(positions, mesh, camera) else {
        return layer;
    };
    let lights = Lights::new();
    let normals = vertex_normals(positions, mesh.triangles());
    let lit = |(triangle, weights): ([u32; 3], [f64; 3])| {
        let corners = triangle.iter().zip(weights);
        let normal: DVec3 = corners.map(|(&v, w)| normals[v as usize] * w).sum();
        let mut albedo = CLAY;
        if let Some(colors) = colors {
            albedo = [0.0; 3];
            for (&v, w) in triangle.iter().zip(weights) {
                for (channel, value) in albedo.iter_mut().zip(colors[v as usize]) {
                    *channel += value * w as f32;
                }
            }
        }
        lights.on(normal.try_normalize().unwrap_or(DVec3::Z), paint(albedo))
    };
    let rows_of = |band: usize| -> Vec<Vec<Option<[f32; 3]>>> {
        let samples = scene.band(band);
        let color = |x, y| mean(samples.of_pixel(x, y).map(lit)).map(|(color, _)| color);
        (0..samples.window.height)
            .map(|y| (0..samples.window.width).map(|x| color(x, y)).collect())
            .collect()
    };
    let bands: Vec<_> = (0..scene.bands.len())
        .into_par_iter()
        .map(rows_of)
        .collect();
    let rows: Vec<_> = bands.into_iter().flatten().collect();
    for (y, row) in rows.iter().enumerate() {
        for (x, sampled) in row.iter().enumerate() {
            let at = (x + scene.window.x, y + scene.window.y);
            if layer.coverage[at] <= 0.0 {
                continue;
            }
            // A pixel that the outline only touches has no sample: it takes the color of its neighbors.
            let around = || {
                let near_rows = &rows[y.saturating_sub(1)..(y + 2).min(rows.len())];
                let columns = x.saturating_sub(1)..(x + 2).min(row.len());
                let near = near_rows.iter().flat_map(|r| &r[columns.clone()]);
                mean(near.flatten().copied()).map(|(color, _)| color)
            };
            layer.color[at] = sampled.or_else(around).unwrap_or_default();
        }
    }
    layer
}

/// Returns the mean color and the number of colors, `None` if there are none
fn mean(colors: impl Iterator<Item = [f32; 3]>) -> Option<([f32; 3], f32)> {
    let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
    for color in colors {
        sum = std::array::from_fn(|i| sum[i] + color[i]);
        count += 1.0;
    }
    (count > 0.0).then(|| (sum.map(|v| v / count), count))
}

/// The pixels around a surface
#[derive(Debug, Clone, Copy)]
struct Window {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl Window {
    /// Returns the pixels that any vertex could touch, with a margin of one; `None` when all lie outside
    fn around(vertices: &[Option<Seen>], camera: &Camera) -> Option<Self> {
        let seen = || vertices.iter().flatten().map(|seen| seen.photo);
        let (low, high) = (seen().reduce(DVec2::min)?, seen().reduce(DVec2::max)?);
        // float to integer casts saturate
        let start = |v: f64| (v - 1.0).max(0.0) as usize;
        let end = |v: f64, size: usize| ((v + 2.0).max(0.0) as usize).min(size);
        let (x, y) = (start(low.x), start(low.y));
        Some(Self {
            x,
            y,
            width: end(high.x, camera.width_px)
                .checked_sub(x)
                .filter(|&w| w > 0)?,
            height: end(high.y, camera.height_px)
                .checked_sub(y)
                .filter(|&h| h > 0)?,
        })
    }
}

/// A surface prepared for drawing in bands of [`BAND_ROWS`] rows
struct Scene<'a> {
    window: Window,
    triangles: &'a [[u32; 3]],
    /// Positions in samples, from the window's corner
    vertices: Vec<Option<Seen>>,
    /// The triangles that overlap each band
    bands: Vec<Vec<u32>>,
}

impl<'a> Scene<'a> {
    /// Prepares a surface; `None` where no part of it is in the picture
    fn new(positions: &[DVec3], mesh: &'a SilhouetteMesh, camera: &Camera) -> Option<Self> {
        let mut vertices = see_all(positions, camera);
        let window = Window::around(&vertices, camera)?;
        let corner = DVec2::new(window.x as f64, window.y as f64);
        for seen in vertices.iter_mut().flatten() {
            seen.photo = (seen.photo - corner) * SAMPLES as f64;
        }
        let mut bands = vec![Vec::new(); window.height.div_ceil(BAND_ROWS)];
        let band_of = |y: f64| (y / (SAMPLES * BAND_ROWS) as f64) as usize;
        let faces = mesh.faces_to_draw(positions);
        for (t, corners) in drawn_triangles(&vertices, mesh.triangles(), faces) {
            let [a, b, c] = corners.map(|corner| corner.photo.y);
            let first = band_of(a.min(b).min(c));
            let last = band_of(a.max(b).max(c)).min(bands.len() - 1);
            for band in bands.iter_mut().take(last + 1).skip(first) {
                band.push(t);
            }
        }
        Some(Self {
            window,
            triangles: mesh.triangles(),
            vertices,
            bands,
        })
    }

    fn corners(&self, triangle: u32) -> Option<[Seen; 3]> {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.vertices[v as usize]);
        Some([a?, b?, c?])
    }

    fn band(&self, band: usize) -> Samples<'_> {
        let from = band * BAND_ROWS;
        let window = Window {
            y: self.window.y + from,
            height: BAND_ROWS.min(self.window.height - from),
            ..self.window
        };
        let rows = from * SAMPLES..(from + window.height) * SAMPLES;
        let triangles = self.bands[band].iter();
        let triangles = triangles.filter_map(|&t| Some((t, self.corners(t)?)));
        Samples {
            first_row: rows.start,
            buffer: DepthBuffer::draw(window.width * SAMPLES, rows, triangles),
            window,
            scene: self,
        }
    }
}

/// The nearest surface at [`SAMPLES`] x [`SAMPLES`] points of each pixel in a band
struct Samples<'a> {
    scene: &'a Scene<'a>,
    /// The pixels of the band; columns and rows are counted from its corner
    window: Window,
    /// Number of samples above the band
    first_row: usize,
    buffer: DepthBuffer,
}

impl Samples<'_> {
    /// Returns whether all samples of a pixel lie on adjacent parts of the surface
    ///
    /// If so, one sample determines its color.
    fn one_surface(&self, x: usize, y: usize) -> bool {
        /// Adjacent parts differ by less than this share of their distance; a hand in front of the trunk is farther
        /// away
        const NEXT: f32 = 0.002;
        let (mut near, mut far) = (0.0_f32, f32::INFINITY);
        for k in 0..SAMPLES * SAMPLES {
            let at = (x * SAMPLES + k % SAMPLES, y * SAMPLES + k / SAMPLES);
            let nearness = self.buffer.nearness[at];
            near = near.max(nearness);
            far = far.min(nearness);
        }
        far > 0.0 && near - far < NEXT * near
    }

    /// Iterates over the non-empty samples of a pixel: a triangle and the position on it
    fn of_pixel(&self, x: usize, y: usize) -> impl Iterator<Item = ([u32; 3], [f64; 3])> {
        let samples = (0..SAMPLES * SAMPLES).map(move |k| (k % SAMPLES, k / SAMPLES));
        samples.filter_map(move |(dx, dy)| {
            let (x, y) = (x * SAMPLES + dx, y * SAMPLES + dy);
            let point = DVec2::new(x as f64 + 0.5, (y + self.first_row) as f64 + 0.5);
            self.on_triangle(self.buffer.triangle[(x, y)], point)
        })
    }

    /// Returns the same at the center of a pixel, on the surface of its first sample
    fn at_center(&self, x: usize, y: usize) -> Option<([u32; 3], [f64; 3])> {
        let triangle = self.buffer.triangle[(x * SAMPLES, y * SAMPLES)];
        let center = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * SAMPLES as f64;
        self.on_triangle(triangle, center + DVec2::Y * self.first_row as f64)
    }

    /// Returns the corners of a triangle and their perspective-correct weights at a point of the picture
    fn on_triangle(&self, triangle: u32, point: DVec2) -> Option<([u32; 3], [f64; 3])> {
        if triangle == NearestSurface::NONE {
            return None;
        }
        let [a, b, c] = self.scene.corners(triangle)?;
        let (ab, ac) = (b.photo - a.photo, c.photo - a.photo);
        let p = point - a.photo;
        let area = ab.perp_dot(ac);
        let (wb, wc) = (p.perp_dot(ac) / area, ab.perp_dot(p) / area);
        let raw = [
            (1.0 - wb - wc) * a.nearness,
            wb * b.nearness,
            wc * c.nearness,
        ];
        let sum: f64 = raw.iter().sum();
        Some((
            self.scene.triangles[triangle as usize],
            raw.map(|w| w / sum),
        ))
    }
}

/// Computes area-weighted unit normals; zero where a vertex has no area around it
fn vertex_normals(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let normal = (b - a).cross(c - a);
        for &v in triangle {
            normals[v as usize] += normal;
        }
    }
    for normal in &mut normals {
        *normal = normal.try_normalize().unwrap_or(DVec3::ZERO);
    }
    normals
}

/// A soft studio: a warm light from the upper left, a weak one at the camera, and a cool sky
///
/// All lights are at infinity, so brightness depends on the normal alone.
struct Lights {
    key: DVec3,
    /// Halfway between the key light and the camera: direction of the highlight
    half: DVec3,
}

impl Lights {
    const HEAD: [f32; 3] = [0.15, 0.15, 0.15];
    const KEY: [f32; 3] = [1.00, 0.955, 0.90];
    const SKY: [f32; 3] = [0.27, 0.29, 0.32];
    const GROUND: [f32; 3] = [0.10, 0.09, 0.085];
    /// How far behind the terminator the key light reaches, as a cosine: it is a wide window, not a point
    const WRAP: f64 = 0.15;
    /// Gloss of skin and clay: faint and broad
    const GLOSS: f32 = 0.05;
    const GLOSS_POWER: i32 = 16;

    fn new() -> Self {
        let key = DVec3::new(-0.72, 0.52, 0.46).normalize_or(DVec3::Z);
        Self {
            key,
            half: (key + DVec3::Z).normalize_or(DVec3::Z),
        }
    }

    fn on(&self, normal: DVec3, albedo: [f32; 3]) -> [f32; 3] {
        let head = normal.z.max(0.0) as f32;
        let key = ((normal.dot(self.key) + Self::WRAP) / (1.0 + Self::WRAP)).max(0.0) as f32;
        let up = (0.5 + 0.5 * normal.y) as f32;
        let gloss = normal.dot(self.half).max(0.0) as f32;
        let gloss = Self::GLOSS * gloss.powi(Self::GLOSS_POWER);
        std::array::from_fn(|k| {
            let sky = Self::GROUND[k] + (Self::SKY[k] - Self::GROUND[k]) * up;
            let light = Self::HEAD[k] * head + Self::KEY[k] * key + sky;
            (albedo[k] * light + gloss).clamp(0.0, 1.0)
        })
    }
}

/// Returns the nearest sRGB level of a linear value, off by at most one level at the border between two
fn level_from_linear(linear: f32) -> u8 {
    const STEPS: usize = 8192;
    static LEVELS: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let level = |i| (255.0 * srgb_from_linear(i as f32 / STEPS as f32) + 0.5) as u8;
        (0..=STEPS).map(level).collect()
    });
    LEVELS[((linear.clamp(0.0, 1.0) * STEPS as f32 + 0.5) as usize).min(STEPS)]
}

/// Converts linear light to an sRGB value (0 to 1)
pub fn srgb_from_linear(linear: f32) -> f32 {
    let v = linear.clamp(0.0, 1.0);
    if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    }
}

/// Converts an sRGB value to linear light (0 to 1)
pub fn linear_from_srgb(srgb: f32) -> f32 {
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
    fn a_ball_is_lit_from_the_front_on_a_light_background() {
        let (positions, triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 300.0, 24);
        let photo = shade(
            &SilhouetteMesh::new(&triangles),
            &positions,
            None,
            &camera(),
        );
        let luma = |x: usize, y: usize| photo[(x, y)].iter().map(|&v| u32::from(v)).sum::<u32>();
        assert!(luma(2, 2) > 3 * 235);
        assert!(luma(80, 100) < luma(2, 2));
        // the upper left is brighter than the lower right
        assert!(luma(68, 85) > luma(92, 115));
    }

    #[test]
    fn vertex_colors_are_rendered() {
        let (positions, triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 300.0, 24);
        let red = vec![[0.8, 0.05, 0.05]; positions.len()];
        let photo = shade(
            &SilhouetteMesh::new(&triangles),
            &positions,
            Some(&red),
            &camera(),
        );
        let [r, g, _] = photo[(80, 100)];
        assert!(r > g + 80);
    }

    #[test]
    fn sample_count_does_not_move_the_outline() {
        let (positions, triangles) = sphere(DVec3::new(0.0, 900.0, 0.0), 300.0, 24);
        let mesh = SilhouetteMesh::new(&triangles);
        let layer = shade_layer(&mesh, &positions, &camera(), |a| a, None);
        assert_eq!(layer.coverage, mesh.silhouette(&positions, &camera()));
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
    fn srgb_survives_a_round_trip() {
        for i in 0..=20 {
            let v = i as f32 / 20.0;
            assert!((linear_from_srgb(srgb_from_linear(v)) - v).abs() < 1e-5);
        }
    }
}
