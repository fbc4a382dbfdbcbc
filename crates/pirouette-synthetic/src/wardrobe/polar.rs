//! Radii of a trunk or limb around an upright axis, and cloth that hangs over them.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use pirouette_geom::section::{convex_hull, perimeter};

/// Number of directions around the axis
pub(super) const ANGLES: usize = 72;

/// Distance between two levels, in mm
pub(super) const STEP_MM: f64 = 12.0;

/// How fast cloth recedes below and above what it hangs from, in mm per mm
const RECEDES_BELOW: f64 = 0.15;
const RECEDES_ABOVE: f64 = 0.8;

/// One value per direction, for each level from the lowest
pub(super) type Ring = [f64; ANGLES];

/// Radii of a surface around an axis, by level and direction, in mm
#[derive(Debug, Clone)]
pub(super) struct Polar {
    low_mm: f64,
    /// Position (x, z) of the axis at each level
    axis: Vec<DVec2>,
    pub(super) radii: Vec<Ring>,
}

impl Polar {
    /// Finds the largest radii of points between two heights; `None` without points
    pub(super) fn new(
        points: impl Iterator<Item = DVec3>,
        [low_mm, high_mm]: [f64; 2],
        axis: impl Fn(f64) -> DVec2,
    ) -> Option<Self> {
        let count = ((high_mm - low_mm) / STEP_MM).max(1.0).ceil() as usize + 1;
        let mut found = Self {
            low_mm,
            axis: (0..count)
                .map(|level| axis(low_mm + level as f64 * STEP_MM))
                .collect(),
            radii: vec![[0.0; ANGLES]; count],
        };
        for point in points {
            let level = ((point.y - low_mm) / STEP_MM).round();
            if level >= 0.0 && (level as usize) < count {
                let (angle, radius) = found.angle_and_radius(point);
                let cell = &mut found.radii[level as usize][angle.round() as usize % ANGLES];
                *cell = cell.max(radius);
            }
        }
        found.fill().then(|| {
            found.radii = smoothed(&found.radii, 1);
            found
        })
    }

    /// Bridges empty directions and copies empty levels; returns whether there was any value
    fn fill(&mut self) -> bool {
        let mut full: Vec<usize> = Vec::new();
        for (level, ring) in self.radii.iter_mut().enumerate() {
            let known: Vec<usize> = (0..ANGLES).filter(|&k| ring[k] > 0.0).collect();
            if known.len() < 4 {
                continue;
            }
            full.push(level);
            for (i, &from) in known.iter().enumerate() {
                let to = known[(i + 1) % known.len()];
                let gap = (to + ANGLES - from) % ANGLES;
                for k in 1..gap {
                    let at = (from + k) % ANGLES;
                    ring[at] = chord([from, at, to], [ring[from], ring[to]], gap, k);
                }
            }
        }
        for level in 0..self.radii.len() {
            if let Some(&nearest) = full.iter().min_by_key(|&&f| f.abs_diff(level)) {
                self.radii[level] = self.radii[nearest];
            }
        }
        !full.is_empty()
    }

    /// Returns the height of a level, in mm
    pub(super) fn height_mm(&self, level: usize) -> f64 {
        self.low_mm + level as f64 * STEP_MM
    }

    fn axis_at(&self, y: f64) -> DVec2 {
        let (low, high, t) = self.levels(y);
        self.axis[low].lerp(self.axis[high], t)
    }

    fn levels(&self, y: f64) -> (usize, usize, f64) {
        let last = self.axis.len() - 1;
        let at = ((y - self.low_mm) / STEP_MM).clamp(0.0, last as f64);
        let low = at.floor() as usize;
        (low, (low + 1).min(last), at.fract())
    }

    fn angle_and_radius(&self, point: DVec3) -> (f64, f64) {
        let from = DVec2::new(point.x, point.z) - self.axis_at(point.y);
        let turns = from.y.atan2(from.x) / TAU;
        (turns.rem_euclid(1.0) * ANGLES as f64, from.length())
    }

    /// Returns the horizontal direction away from the axis; it vanishes within 15 mm of the axis
    pub(super) fn outward(&self, point: DVec3) -> DVec3 {
        let from = DVec2::new(point.x, point.z) - self.axis_at(point.y);
        let way = from.normalize_or_zero() * super::smooth_step(15.0, 50.0, from.length());
        DVec3::new(way.x, 0.0, way.y)
    }

    /// Returns the point at a direction and a radius
    pub(super) fn point(&self, level: usize, angle: usize, radius: f64) -> DVec3 {
        let place = self.axis[level] + direction(angle) * radius;
        DVec3::new(place.x, self.height_mm(level), place.y)
    }

    /// Interpolates values at a point
    pub(super) fn value_at(&self, values: &[Ring], point: DVec3) -> f64 {
        let (low, high, t) = self.levels(point.y);
        let angle = self.angle_and_radius(point).0;
        let (left, s) = (angle.floor() as usize % ANGLES, angle.fract());
        let along = |ring: &Ring| ring[left] * (1.0 - s) + ring[(left + 1) % ANGLES] * s;
        along(&values[low]) * (1.0 - t) + along(&values[high]) * t
    }

    /// Returns the radii of cloth that is taut around each level and hangs from those above
    pub(super) fn envelope(&self) -> Vec<Ring> {
        let mut rings: Vec<Ring> = self.radii.iter().map(taut).collect();
        for level in (0..rings.len().saturating_sub(1)).rev() {
            let above = rings[level + 1];
            recede(&mut rings[level], &above, RECEDES_BELOW);
        }
        for level in 1..rings.len() {
            let below = rings[level - 1];
            recede(&mut rings[level], &below, RECEDES_ABOVE);
        }
        rings
    }

    /// Returns the distance of cloth from the surface, whose girth is larger by `ease_mm` of the height
    ///
    /// Cloth bridges hollows first; what remains of the ease is an equal distance all around.
    pub(super) fn drape(&self, ease_mm: impl Fn(f64) -> f64) -> Vec<Ring> {
        let envelope = self.envelope();
        let rings = self.radii.iter().zip(&envelope).enumerate();
        let distances: Vec<Ring> = rings
            .map(|(level, (radii, envelope))| {
                let ease_mm = ease_mm(self.height_mm(level)).max(0.0);
                let with = |share: f64| -> Ring {
                    std::array::from_fn(|k| radii[k] + share * (envelope[k] - radii[k]))
                };
                let gain = |share: f64| girth(&with(share)) - girth(radii);
                let mut share = 1.0;
                if gain(1.0) > ease_mm {
                    let (mut low, mut high) = (0.0, 1.0);
                    for _ in 0..12 {
                        share = (low + high) / 2.0;
                        if gain(share) > ease_mm {
                            high = share;
                        } else {
                            low = share;
                        }
                    }
                }
                let even = (ease_mm - gain(share)).max(0.0) / TAU;
                // Without ease, cloth is as tight as skin, also in hollows.
                let share = share * super::smooth_step(0.0, 20.0, ease_mm);
                std::array::from_fn(|k| share * (envelope[k] - radii[k]).max(0.0) + even)
            })
            .collect();
        smoothed(&distances, 2)
    }
}

fn direction(angle: usize) -> DVec2 {
    DVec2::from_angle(TAU * angle as f64 / ANGLES as f64)
}

/// Returns the radius of the straight line between two points of a ring; of an arc if they are half a turn apart or more
fn chord([from, at, to]: [usize; 3], radii: [f64; 2], gap: usize, step: usize) -> f64 {
    let (a, b) = (direction(from) * radii[0], direction(to) * radii[1]);
    if 2 * gap < ANGLES {
        a.perp_dot(b - a) / direction(at).perp_dot(b - a)
    } else {
        radii[0] + (radii[1] - radii[0]) * step as f64 / gap as f64
    }
}

fn recede(ring: &mut Ring, from: &Ring, slope: f64) {
    for (radius, from) in ring.iter_mut().zip(from) {
        *radius = radius.max(from - slope * STEP_MM);
    }
}

fn outline(ring: &Ring) -> Vec<DVec2> {
    let points = ring.iter().enumerate();
    points.map(|(k, radius)| direction(k) * *radius).collect()
}

/// Returns the length of a tape around a ring, in mm
fn girth(ring: &Ring) -> f64 {
    perimeter(&convex_hull(&outline(ring)))
}

/// Returns the radii of the convex hull of a ring
fn taut(ring: &Ring) -> Ring {
    let hull = convex_hull(&outline(ring));
    std::array::from_fn(|k| {
        let ray = direction(k);
        let sides = hull.iter().zip(hull.iter().cycle().skip(1));
        let crossings = sides.filter_map(|(&a, &b)| {
            let side = b - a;
            let facing = ray.perp_dot(side);
            (facing > 0.0).then(|| a.perp_dot(side) / facing)
        });
        crossings
            .fold(f64::INFINITY, f64::min)
            .min(1e4)
            .max(ring[k])
    })
}

/// Averages each value with its neighbors in level and direction, a number of times
fn smoothed(rings: &[Ring], rounds: usize) -> Vec<Ring> {
    let mut rings = rings.to_vec();
    for _ in 0..rounds {
        let last = rings.len() - 1;
        rings = (0..rings.len())
            .map(|level| {
                let [below, own, above] =
                    [level.saturating_sub(1), level, (level + 1).min(last)].map(|l| rings[l]);
                let upright: Ring =
                    std::array::from_fn(|k| (below[k] + 2.0 * own[k] + above[k]) / 4.0);
                std::array::from_fn(|k| {
                    let [left, right] = [(k + ANGLES - 1) % ANGLES, (k + 1) % ANGLES];
                    (upright[left] + 2.0 * upright[k] + upright[right]) / 4.0
                })
            })
            .collect();
    }
    rings
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a tube whose radius depends on the height
    fn tube(radius: impl Fn(f64) -> f64) -> Polar {
        let points = (0..=40).flat_map(|level| {
            let y = f64::from(level) * 10.0;
            let radius = radius(y);
            (0..144).map(move |k| {
                let way = DVec2::from_angle(TAU * f64::from(k) / 144.0) * radius;
                DVec3::new(way.x, y, way.y)
            })
        });
        let points: Vec<DVec3> = points.collect();
        Polar::new(points.into_iter(), [0.0, 400.0], |_| DVec2::ZERO).expect("there are points")
    }

    #[test]
    fn the_girth_grows_by_the_ease_and_hollows_are_bridged_first() {
        let waisted = tube(|y| 150.0 - 30.0 * (-((y - 200.0) / 60.0).powi(2)).exp());
        let distances = waisted.drape(|_| 100.0);
        for (level, ring) in distances.iter().enumerate() {
            let worn: Ring = std::array::from_fn(|k| waisted.radii[level][k] + ring[k]);
            let gain = girth(&worn) - girth(&waisted.radii[level]);
            assert!((gain - 100.0).abs() < 6.0, "{gain} mm at level {level}");
        }
        assert!(
            waisted
                .drape(|_| 0.0)
                .iter()
                .flatten()
                .all(|d| d.abs() < 1e-6)
        );
    }

    #[test]
    fn cloth_hangs_from_what_is_above() {
        let shelf = tube(|y| if y > 200.0 { 150.0 } else { 100.0 });
        let envelope = shelf.envelope();
        assert!(envelope[8][0] > 125.0, "{}", envelope[8][0]);
    }
}
