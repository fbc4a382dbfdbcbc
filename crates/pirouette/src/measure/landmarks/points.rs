//! Named points of the surface, exact to within its facets: vertices would jump between bodies by half an edge.

use glam::DVec3;

use super::levels::{BUST_MIN_X, Levels};
use super::{Body, Limbs, Plane};
use crate::measure::Landmark;
use pirouette_body::Bone;

/// Seventh cervical vertebra above the neck's joint, as a share of the stature
const NAPE_ABOVE_NECK: f64 = 0.004;

/// Points are weighted by `exp(-depth behind the foremost / this)`, a share of the stature (4 mm)
const BUST_POINT_SOFTNESS: f64 = 0.0025;

/// Direction from the neck's joint to the side of the neck, above level
const SIDE_NECK_DEGREES: f64 = 25.0;

impl Body<'_> {
    pub(super) fn landmarks(&self, levels: &Levels) -> Vec<(Landmark, DVec3)> {
        let mut found: Vec<(Landmark, DVec3)> = Vec::new();
        let mut add = |landmark: Landmark, point: Option<DVec3>| {
            found.extend(point.map(|p| (landmark, p)));
        };
        add(Landmark::Crown, self.foremost(|_| true, |p| p.y));
        let hips = self.middle_of(Bone::LeftThigh, Bone::RightThigh);
        let in_middle = |y: f64, inside: Bone, direction: DVec3| {
            let inner = DVec3::new(hips.x, y, self.head(inside).z);
            self.surface_from(inner, direction)
        };
        let nape = self.head(Bone::Neck).y + NAPE_ABOVE_NECK * self.stature;
        add(Landmark::Nape, in_middle(nape, Bone::Neck, -DVec3::Z));
        add(
            Landmark::WaistFront,
            in_middle(levels.waist, Bone::LowerSpine, DVec3::Z),
        );
        add(
            Landmark::WaistBack,
            in_middle(levels.waist, Bone::LowerSpine, -DVec3::Z),
        );
        let band = 0.01 * self.stature;
        let at = |p: DVec3, level: f64| (p.y - level).abs() < band;
        let trunk = |v: usize| self.armless[v];
        let backward = |p: DVec3| if at(p, levels.seat) { -p.z } else { f64::NAN };
        add(Landmark::Seat, self.foremost(trunk, backward));
        add(Landmark::Crotch, Some(levels.crotch));
        let middle = self.head(Bone::UpperSpine).x;
        let sides = [
            [
                Landmark::LeftBustPoint,
                Landmark::LeftAcromion,
                Landmark::LeftWrist,
                Landmark::LeftSideNeck,
                Landmark::LeftWaistFront,
            ],
            [
                Landmark::RightBustPoint,
                Landmark::RightAcromion,
                Landmark::RightWrist,
                Landmark::RightSideNeck,
                Landmark::RightWaistFront,
            ],
        ];
        let limbs = [&self.left, &self.right];
        for (limbs, [bust, acromion, wrist, side_neck, waist]) in limbs.into_iter().zip(sides) {
            let bust_point = self.bust_point(levels.bust, limbs.outward, middle);
            add(bust, bust_point);
            let below = bust_point.and_then(|p| {
                let inner = DVec3::new(p.x, levels.waist, self.head(Bone::LowerSpine).z);
                self.surface_from(inner, DVec3::Z)
            });
            add(waist, below);
            let (sin, cos) = SIDE_NECK_DEGREES.to_radians().sin_cos();
            let beside = DVec3::new(cos * limbs.outward, sin, 0.0);
            add(side_neck, self.surface_from(self.head(Bone::Neck), beside));
            // straight above the joint
            let shoulder = self.head(limbs.upper_arm);
            add(acromion, self.surface_from(shoulder, DVec3::Y));
            add(wrist, self.outer_wrist(limbs));
        }
        found
    }

    /// Returns the frontmost point of a level on one side of the chest
    ///
    /// Chests are flat there: the mean of all points, those further behind with less weight, varies less than the foremost.
    fn bust_point(&self, level: f64, outward: f64, middle: f64) -> Option<DVec3> {
        let points = self.trunk.cut(Plane::level(level));
        let beside = |p: DVec3| (p.x - middle) * outward > BUST_MIN_X * self.stature;
        let points: Vec<DVec3> = points
            .iter()
            .map(|c| c.point)
            .filter(|&p| beside(p))
            .collect();
        let front = points.iter().map(|p| p.z).reduce(f64::max)?;
        let softness = BUST_POINT_SOFTNESS * self.stature;
        let (mut weights, mut sum) = (0.0, 0.0);
        for p in &points {
            let weight = ((p.z - front) / softness).exp();
            weights += weight;
            sum += weight * p.x;
        }
        let inner = DVec3::new(sum / weights, level, self.head(Bone::UpperSpine).z);
        self.surface_from(inner, DVec3::Z)
    }

    /// Returns the outer side of the wrist, in the direction of the upper arm
    fn outer_wrist(&self, limbs: &Limbs<'_>) -> Option<DVec3> {
        let (elbow, hand) = (self.head(limbs.forearm), self.head(limbs.hand));
        let along = (hand - elbow).try_normalize()?;
        let out = DVec3::X * limbs.outward + DVec3::Y;
        let out = (out - along * out.dot(along)).try_normalize()?;
        self.surface_from(hand, out)
    }

    /// Returns the vertex with the best score among those accepted by `keep`
    fn foremost(
        &self,
        keep: impl Fn(usize) -> bool,
        score: impl Fn(DVec3) -> f64,
    ) -> Option<DVec3> {
        let vertices = self.mesh.positions.iter().enumerate();
        let kept = vertices.filter(|(v, _)| keep(*v));
        let scored = kept.map(|(_, &p)| (p, score(p)));
        let best = scored.filter(|(_, score)| score.is_finite());
        best.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(p, _)| p)
    }

    /// Returns the last point where a ray from inside the body leaves it
    fn surface_from(&self, inner: DVec3, direction: DVec3) -> Option<DVec3> {
        let corners = self.mesh.triangles.iter();
        corners
            .filter_map(|t| {
                let corners = t.map(|v| self.mesh.positions[v as usize]);
                distance_to_triangle(inner, direction, corners)
            })
            .reduce(f64::max)
            .map(|distance| inner + direction * distance)
    }
}

/// Returns the distance along a ray to a triangle, in lengths of `direction`; `None` when it misses
///
/// # Source
/// Möller and Trumbore (1997), "Fast, minimum storage ray-triangle intersection", section 2. Edges belong to the triangle.
fn distance_to_triangle(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    /// Because of rounding, rays through an edge hit at least one of its triangles
    const SLACK: f64 = 1e-9;
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let volume = ab.dot(across);
    let from_a = origin - a;
    let u = from_a.dot(across) / volume;
    let turned = from_a.cross(ab);
    let v = direction.dot(turned) / volume;
    let inside = u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK;
    let distance = ac.dot(turned) / volume;
    (inside && distance > 0.0 && distance.is_finite()).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_ray_meets_a_triangle_where_their_plane_is() {
        let triangle = [
            DVec3::new(0.0, 0.0, 5.0),
            DVec3::new(4.0, 0.0, 5.0),
            DVec3::new(0.0, 4.0, 7.0),
        ];
        let hit = |x, y| distance_to_triangle(DVec3::new(x, y, 0.0), DVec3::Z, triangle);
        assert!((hit(1.0, 2.0).unwrap() - 6.0).abs() < 1e-12);
        assert!((hit(2.0, 0.0).unwrap() - 5.0).abs() < 1e-12);
        assert_eq!(hit(3.0, 2.0), None);
        assert_eq!(distance_to_triangle(DVec3::ZERO, -DVec3::Z, triangle), None);
        assert_eq!(distance_to_triangle(DVec3::ZERO, DVec3::X, triangle), None);
    }

    proptest! {
        #[test]
        fn a_ray_to_a_point_of_a_triangle_meets_it_there(
            corners in prop::array::uniform3(prop::array::uniform3(-10.0..10.0f64)),
            shares in prop::array::uniform2(0.05..0.9f64),
            origin in prop::array::uniform3(-20.0..20.0f64),
        ) {
            let [a, b, c] = corners.map(DVec3::from_array);
            let [u, v] = shares;
            let point = a + (b - a) * u * (1.0 - v) + (c - a) * v;
            let direction = point - DVec3::from_array(origin);
            let flatness = (b - a).cross(c - a).dot(direction).abs();
            prop_assume!(flatness > 1.0);
            let distance = distance_to_triangle(DVec3::from_array(origin), direction, [a, b, c]);
            prop_assert!((distance.unwrap() - 1.0).abs() < 1e-6);
        }
    }
}
