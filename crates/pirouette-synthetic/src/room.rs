//! A furnished room, ray-traced: floor, wall and furniture are static while the person turns.

use glam::{DVec2, DVec3};
use pirouette_geom::Grid;
use pirouette_geom::parallel::prelude::*;

use super::random::{Random, noise, rough_noise};
use pirouette_body::Camera;

/// Light before the gamma curve, one value per channel; 1 is white
pub(super) type Light = Grid<[f32; 3]>;

/// Amount of furniture behind the person
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Clutter {
    /// Floor and a wall of one color
    Plain,
    /// Shelf, sofa, plant, pictures, curtain, rug
    #[default]
    LivedIn,
}

/// A box of one material, standing or hanging in the room
#[derive(Debug, Clone)]
struct Furniture {
    low: DVec3,
    high: DVec3,
    color: DVec3,
    texture: Texture,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Texture {
    Plain,
    Wood,
    Cloth,
    Books,
    Leaves,
    Painting,
}

/// The static surroundings of one scan
#[derive(Debug, Clone)]
pub(super) struct Room {
    seed: u64,
    wall_z: f64,
    wall_color: DVec3,
    floor_color: DVec3,
    clutter: Clutter,
    furniture: Vec<Furniture>,
    rug: Option<(DVec2, DVec2, DVec3)>,
}

/// Skirting board of the wall, in mm
const SKIRTING_MM: f64 = 90.0;

impl Room {
    pub(super) fn new(seed: u64, clutter: Clutter) -> Self {
        let random = &mut Random::new(seed ^ 0x0f00_d000);
        let wall_z = -random.between(900.0, 1500.0);
        let mut room = Self {
            seed,
            wall_z,
            wall_color: hue(random, 0.55, 0.85, 0.25),
            floor_color: DVec3::new(0.42, 0.30, 0.20) * random.between(0.7, 1.3),
            clutter,
            furniture: Vec::new(),
            rug: None,
        };
        if clutter == Clutter::LivedIn {
            room.furnish(random);
        }
        room
    }

    fn furnish(&mut self, random: &mut Random) {
        let z = self.wall_z;
        let side = if random.uniform() < 0.5 { 1.0 } else { -1.0 };
        let mut put = |x: f64, y: f64, depth: f64, size: DVec2, color: DVec3, texture: Texture| {
            let low = DVec3::new(side * x - size.x / 2.0, y, z);
            let high = DVec3::new(side * x + size.x / 2.0, y + size.y, z + depth);
            self.furniture.push(Furniture {
                low,
                high,
                color,
                texture,
            });
        };
        // A shelf of books, a sofa, a plant in a pot, two paintings and a curtain.
        let shelf = random.between(550.0, 700.0);
        put(
            shelf,
            0.0,
            300.0,
            DVec2::new(620.0, 1900.0),
            DVec3::new(0.32, 0.20, 0.12),
            Texture::Wood,
        );
        for level in 0..5 {
            let height = 90.0 + 370.0 * f64::from(level);
            put(
                shelf,
                height,
                305.0,
                DVec2::new(560.0, random.between(200.0, 280.0)),
                DVec3::ONE,
                Texture::Books,
            );
        }
        let sofa = hue(random, 0.25, 0.5, 0.6);
        let place = -random.between(550.0, 700.0);
        put(
            place,
            0.0,
            700.0,
            DVec2::new(1000.0, 420.0),
            sofa,
            Texture::Cloth,
        );
        put(
            place,
            0.0,
            220.0,
            DVec2::new(1050.0, 820.0),
            sofa * 0.9,
            Texture::Cloth,
        );
        let cushion = hue(random, 0.4, 0.8, 0.8);
        put(
            place + 150.0,
            430.0,
            420.0,
            DVec2::new(380.0, 330.0),
            cushion,
            Texture::Cloth,
        );
        put(
            -1150.0,
            0.0,
            380.0,
            DVec2::new(330.0, 330.0),
            DVec3::new(0.55, 0.26, 0.16),
            Texture::Plain,
        );
        put(
            -1150.0,
            330.0,
            420.0,
            DVec2::new(520.0, 850.0),
            DVec3::new(0.13, 0.33, 0.12),
            Texture::Leaves,
        );
        for (x, y, w, h) in [
            (-420.0, 1350.0, 520.0, 400.0),
            (170.0, 1450.0, 300.0, 420.0),
        ] {
            put(
                x,
                y,
                25.0,
                DVec2::new(w, h),
                DVec3::splat(0.12),
                Texture::Plain,
            );
            let color = hue(random, 0.4, 0.8, 0.7);
            put(
                x,
                y + 30.0,
                30.0,
                DVec2::new(w - 60.0, h - 60.0),
                color,
                Texture::Painting,
            );
        }
        let rug = hue(random, 0.3, 0.6, 0.6);
        self.rug = Some((DVec2::new(0.0, 150.0), DVec2::new(900.0, 650.0), rug));
    }

    /// Renders the empty room
    pub(super) fn render(&self, camera: &Camera) -> Light {
        let (width, height) = (camera.width_px, camera.height_px);
        let rows: Vec<Vec<[f32; 3]>> = (0..height)
            .into_par_iter()
            .map(|y| {
                (0..width)
                    .map(|x| {
                        let ray = camera.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                        let c = self.trace(camera.center(), ray);
                        [c.x as f32, c.y as f32, c.z as f32]
                    })
                    .collect()
            })
            .collect();
        Grid::from_vec(width, height, rows.concat())
    }

    fn trace(&self, origin: DVec3, ray: DVec3) -> DVec3 {
        let mut nearest = f64::INFINITY;
        let mut light = DVec3::splat(0.6);
        if ray.z < 0.0 {
            nearest = (self.wall_z - origin.z) / ray.z;
            light = self.wall(origin + ray * nearest);
        }
        if ray.y < 0.0 {
            let t = -origin.y / ray.y;
            if t < nearest {
                nearest = t;
                light = self.floor(origin + ray * t);
            }
        }
        for item in &self.furniture {
            if let Some((t, normal)) = hit_box(item, origin, ray)
                && t < nearest
            {
                nearest = t;
                light = self.surface(item, origin + ray * t, normal);
            }
        }
        light
    }

    fn wall(&self, p: DVec3) -> DVec3 {
        let shade = 0.85 + 0.15 * rough_noise(p / 900.0, self.seed);
        if self.clutter == Clutter::LivedIn {
            if p.y < SKIRTING_MM {
                return DVec3::splat(0.75 * shade);
            }
            // wallpaper: broad stripes with a fine weave
            let stripe = if (p.x / 130.0).rem_euclid(2.0) < 1.0 {
                0.93
            } else {
                1.0
            };
            let weave = 0.97 + 0.06 * noise(p / 9.0, self.seed ^ 3);
            return self.wall_color * shade * stripe * weave;
        }
        self.wall_color * shade
    }

    fn floor(&self, p: DVec3) -> DVec3 {
        let shade = 0.8 + 0.2 * rough_noise(p / 700.0, self.seed ^ 1);
        if let Some((center, half, color)) = self.rug {
            let q = (DVec2::new(p.x, p.z) - center) / half;
            let r = q.length();
            if r < 1.0 {
                let ring = if (r * 7.0).rem_euclid(2.0) < 1.0 {
                    0.8
                } else {
                    1.0
                };
                return color * shade * ring * (0.9 + 0.2 * noise(p / 6.0, self.seed ^ 8));
            }
        }
        let plank = (p.x / 140.0).floor();
        let tone = 0.8
            + 0.4
                * noise(
                    DVec3::new(plank * 7.3, (p.z / 1400.0 + plank * 0.37).floor(), 0.5),
                    self.seed ^ 2,
                );
        let grain = 0.9 + 0.2 * noise(DVec3::new(p.x / 9.0, 0.0, p.z / 160.0), self.seed ^ 4);
        let gap = if (p.x / 140.0).rem_euclid(1.0) < 0.02 {
            0.6
        } else {
            1.0
        };
        self.floor_color * shade * tone * grain * gap
    }

    fn surface(&self, item: &Furniture, p: DVec3, normal: DVec3) -> DVec3 {
        let facing = 0.65 + 0.35 * normal.dot(DVec3::new(0.3, 0.7, 0.65)).max(0.0);
        let q = (p - item.low) / (item.high - item.low);
        let color = match item.texture {
            Texture::Plain => item.color,
            Texture::Wood => {
                item.color * (0.8 + 0.4 * noise(p / DVec3::new(9.0, 160.0, 9.0), self.seed ^ 5))
            }
            Texture::Cloth => item.color * (0.85 + 0.3 * noise(p / 7.0, self.seed ^ 6)),
            Texture::Books => {
                let book = (p.x / 38.0).floor();
                let shelf = (item.low.y / 50.0).floor();
                let mut random = Random::new(
                    self.seed
                        ^ (book as i64 as u64).wrapping_mul(977)
                        ^ (shelf as i64 as u64) << 20,
                );
                let top = random.between(0.75, 1.0);
                if q.y > top {
                    DVec3::splat(0.06)
                } else {
                    hue(&mut random, 0.1, 0.7, 0.7)
                }
            }
            Texture::Leaves => {
                let n = rough_noise(p / 70.0, self.seed ^ 7);
                let light = if n > 0.5 { 1.5 } else { 0.5 };
                item.color * light
            }
            Texture::Painting => {
                let n = rough_noise(DVec3::new(q.x, q.y, 0.0) * 3.0, self.seed ^ 9);
                item.color * (0.4 + 1.2 * n) + DVec3::new(0.2 * q.y, 0.1 * q.x, 0.15)
            }
        };
        color * facing
    }
}

/// Returns the distance along the ray and the outward normal where it enters a box
fn hit_box(item: &Furniture, origin: DVec3, ray: DVec3) -> Option<(f64, DVec3)> {
    let a = (item.low - origin) / ray;
    let b = (item.high - origin) / ray;
    let (near, far) = (a.min(b), a.max(b));
    let enter = near.max_element();
    if enter <= 0.0 || enter > far.min_element() {
        return None;
    }
    let axis = (0..3).find(|&k| near[k] >= enter)?;
    Some((enter, -DVec3::AXES[axis] * ray[axis].signum()))
}

/// Returns a random color of given lightness range and saturation
pub(super) fn hue(random: &mut Random, dark: f64, light: f64, saturation: f64) -> DVec3 {
    let level = random.between(dark, light);
    let tint = DVec3::new(random.uniform(), random.uniform(), random.uniform());
    let mean = (tint.x + tint.y + tint.z) / 3.0;
    (DVec3::ONE + (tint - mean) * saturation * 1.4) * level
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_enters_a_box_at_its_front() {
        let item = Furniture {
            low: DVec3::new(-1.0, -1.0, -3.0),
            high: DVec3::new(1.0, 1.0, -2.0),
            color: DVec3::ONE,
            texture: Texture::Plain,
        };
        let hit = hit_box(&item, DVec3::ZERO, DVec3::new(0.0, 0.0, -1.0));
        assert_eq!(hit, Some((2.0, DVec3::Z)));
        assert_eq!(hit_box(&item, DVec3::ZERO, DVec3::Z), None);
    }
}
