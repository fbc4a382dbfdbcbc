//! Finds an ID-1 card (bank card, identity card) in a photo, by edges and Hough lines.
//!
//! In each window of suitable size, the Hough transform of the edges finds the lines; four of them that enclose a
//! quadrilateral whose sides are edges along nearly their entire length are a candidate. The map from the card's known
//! sides to the found ones has two singular values: the larger one is the scale, which a tilt does not change, the
//! smaller one is shortened by the cosine of the tilt. A rectangle of another aspect ratio would need an implausibly
//! large tilt: it is rejected.
//!
//! Not supported: cards covered by fingers along an entire side, or in front of a background of the same color.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::{DMat2, DVec2};
use pirouette_geom::parallel::prelude::*;
use thiserror::Error;

use super::edges::{EdgePoint, edge_points};
use crate::scan::Photo;

/// Width and height of an ID-1 card (ISO/IEC 7810), in mm
pub const CARD_MM: [f64; 2] = [85.60, 53.98];

/// A card in a photo
#[derive(Debug, Clone, PartialEq)]
pub struct Card {
    /// Its corners in order around it, in photo px
    pub corners: [DVec2; 4],
    /// Size of a pixel at the card, in mm
    pub mm_per_px: f64,
    /// Tilt out of the image plane, in degrees
    pub tilt_degrees: f64,
    /// Share of its sides visible as edges, 0 to 1
    pub coverage: f64,
}

/// Why no card was found in a photo
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum CardError {
    #[error("no person in the photo, so the search region for the card is unknown")]
    NoPerson,
    #[error("no quadrilateral of a card's shape")]
    NotFound,
    #[error("several quadrilaterals of a card's shape but different sizes")]
    Ambiguous,
}

/// Statures, in mm, over which the scale is searched: the joints, from eyes to ankles, span about 0.9 of it
const JOINT_SPAN_MM: [f64; 2] = [900.0, 2000.0];

/// Search distance for cards around the person, as a share of the person's height
const AROUND: f64 = 0.35;

/// Largest tilt of cards, in degrees: 20 plus a margin for noise
const MAX_TILT_DEGREES: f64 = 25.0;

/// Smallest share of each side that must be visible as an edge
const MIN_COVERAGE: f64 = 0.85;

/// Largest relative difference between opposite sides of a card: it is small compared to its distance
const MAX_SIDE_RATIO: f64 = 1.08;

/// Largest relative difference between candidates of one card
const SAME_SCALE: f64 = 0.02;

/// Finds a card near a person whose joints are at `person` in the photo
///
/// # Errors
/// When there is no card, or several candidates are inconsistent: it never guesses.
pub fn find_card(photo: &Photo, person: &[DVec2]) -> Result<Card, CardError> {
    let finite = || person.iter().filter(|p| p.is_finite());
    let low = finite().fold(DVec2::INFINITY, |low, p| low.min(*p));
    let high = finite().fold(DVec2::NEG_INFINITY, |high, p| high.max(*p));
    let span = high.y - low.y;
    if !(span.is_finite() && span > 20.0) {
        return Err(CardError::NoPerson);
    }
    let scales = JOINT_SPAN_MM.map(|mm| mm / span);
    let margin = DVec2::new(AROUND, 0.05) * span;
    let inside = |p: DVec2| p.cmpge(low - margin).all() && p.cmple(high + margin).all();
    let least = (CARD_MM[0] + CARD_MM[1]) / scales[1];
    let most = CARD_MM[0].hypot(CARD_MM[1]) / scales[0];
    let points: Vec<EdgePoint> = edge_points(photo)
        .into_iter()
        .filter(|point| inside(point.position))
        .collect();
    let mut cards: Vec<Card> = windows(&points, most)
        .into_par_iter()
        .filter(|window| window.len() >= least as usize)
        .filter_map(|window| card_of(&window))
        .filter(|card| (scales[0]..scales[1]).contains(&card.mm_per_px))
        .collect();
    cards.sort_by(|a, b| b.coverage.total_cmp(&a.coverage));
    let best = cards.first().ok_or(CardError::NotFound)?;
    let same = |card: &Card| (card.mm_per_px / best.mm_per_px - 1.0).abs() < SAME_SCALE;
    if cards.iter().all(same) {
        Ok(best.clone())
    } else {
        Err(CardError::Ambiguous)
    }
}

/// Groups points into overlapping squares of `size` px and half as much again: a card lies entirely in one of them,
/// even if its edges continue into a hand or sleeve
fn windows(points: &[EdgePoint], size: f64) -> Vec<Vec<EdgePoint>> {
    let step = size / 2.0;
    let mut windows: BTreeMap<(i64, i64), Vec<EdgePoint>> = BTreeMap::new();
    for point in points {
        let cell = (point.position / step).floor();
        for dy in 0..3 {
            for dx in 0..3 {
                let place = (cell.x as i64 - dx, cell.y as i64 - dy);
                windows.entry(place).or_default().push(*point);
            }
        }
    }
    windows.into_values().collect()
}

/// A line: points `p` with `p . normal = offset`
#[derive(Debug, Clone, Copy)]
struct Line {
    normal: DVec2,
    offset: f64,
}

impl Line {
    fn distance(&self, p: DVec2) -> f64 {
        p.dot(self.normal) - self.offset
    }

    fn meet(&self, other: &Self) -> Option<DVec2> {
        let matrix = DMat2::from_cols(self.normal, other.normal).transpose();
        let determinant = matrix.determinant();
        (determinant.abs() > 0.3).then(|| matrix.inverse() * DVec2::new(self.offset, other.offset))
    }
}

/// Returns the card outlined by edges, if any
fn card_of(group: &[EdgePoint]) -> Option<Card> {
    let lines = hough_lines(group);
    let mut best: Option<Card> = None;
    for (i, a) in lines.iter().enumerate() {
        for b in &lines[i + 1..] {
            if !nearly_parallel(a, b) {
                continue;
            }
            for (j, c) in lines.iter().enumerate() {
                for d in &lines[j + 1..] {
                    // Each pair of pairs once
                    if !nearly_parallel(c, d) || c.normal.dot(a.normal).abs() > 0.5 || j < i {
                        continue;
                    }
                    let corners = [a.meet(c), a.meet(d), b.meet(d), b.meet(c)];
                    let [Some(p), Some(q), Some(r), Some(s)] = corners else {
                        continue;
                    };
                    let card = check(&[p, q, r, s], group);
                    if let Some(card) = card
                        && best.as_ref().is_none_or(|b| card.coverage > b.coverage)
                    {
                        best = Some(card);
                    }
                }
            }
        }
    }
    best.and_then(|card| settle(card, group))
}

/// Returns the card whose sides run through the edge points along them, excluding corners
///
/// A line found by all points near it may be biased by edges beyond the card.
fn settle(mut card: Card, group: &[EdgePoint]) -> Option<Card> {
    for near in [2.0, 1.5, 1.0] {
        let mut sides = Vec::with_capacity(4);
        for i in 0..4 {
            let (from, to) = (card.corners[i], card.corners[(i + 1) % 4]);
            let length = from.distance(to);
            let along = (to - from).try_normalize()?;
            let on = group.iter().filter(|point| {
                let d = point.position - from;
                let part = d.dot(along) / length;
                (SIDE_CORNER..1.0 - SIDE_CORNER).contains(&part)
                    && along.perp_dot(d).abs() < near
                    && along.perp_dot(point.normal).abs() > 0.9
            });
            sides.push(through(
                &on.map(|point| point.position).collect::<Vec<_>>(),
            )?);
        }
        let mut corners = [DVec2::ZERO; 4];
        for (i, corner) in corners.iter_mut().enumerate() {
            *corner = sides[(i + 3) % 4].meet(&sides[i])?;
        }
        card = check(&corners, group)?;
    }
    Some(card)
}

/// Fits a line to points by least squares of the perpendicular distance; `None` for few points
fn through(points: &[DVec2]) -> Option<Line> {
    if points.len() < 8 {
        return None;
    }
    let mean = points.iter().sum::<DVec2>() / points.len() as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = *p - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let normal = DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy)).perp();
    Some(Line {
        normal,
        offset: mean.dot(normal),
    })
}

/// Share of a side that belongs to the rounded corner at either end
///
/// Radius of the corners (ISO/IEC 7810 allows 2.88 to 3.48 mm) over the shorter side, plus a margin.
const SIDE_CORNER: f64 = 0.09;

/// The same where coverage is counted, in mm along any side
const CORNER_MM: f64 = 4.9;

/// An edge reaches a rounded corner when it is seen within this length from there, in mm
const END_MM: f64 = 3.0;

fn nearly_parallel(a: &Line, b: &Line) -> bool {
    a.normal.perp_dot(b.normal).abs() < 0.15
}

/// Finds lines that many points of a group lie on: peaks of the Hough transform, each refined by least squares
fn hough_lines(group: &[EdgePoint]) -> Vec<Line> {
    const ANGLES: usize = 90;
    /// Points vote only for lines perpendicular to their normal and for this many adjacent directions
    const SPREAD: isize = 2;
    const MAX_LINES: usize = 14;
    let origin = group.iter().map(|p| p.position).sum::<DVec2>() / group.len() as f64;
    let radius = group
        .iter()
        .map(|p| p.position.distance(origin))
        .fold(1.0, f64::max);
    let bins = 2 * radius.ceil() as usize + 3;
    let mut votes = vec![0u32; ANGLES * bins];
    let angle = |k: usize| PI * k as f64 / ANGLES as f64;
    for point in group {
        let own = point.normal.y.atan2(point.normal.x).rem_euclid(PI) / PI * ANGLES as f64;
        for spread in -SPREAD..=SPREAD {
            let k = (own.round() as isize + spread).rem_euclid(ANGLES as isize) as usize;
            let rho = (point.position - origin).dot(DVec2::from_angle(angle(k)));
            let bin = (rho + radius + 1.5) as usize;
            votes[k * bins + bin.min(bins - 1)] += 1;
        }
    }
    let mut lines: Vec<Line> = Vec::new();
    let mut order: Vec<usize> = (0..votes.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(votes[i]));
    for index in order {
        if lines.len() >= MAX_LINES || votes[index] < 8 {
            break;
        }
        let normal = DVec2::from_angle(angle(index / bins));
        let rho = (index % bins) as f64 + 0.5 - radius - 1.5 + 0.5;
        let start = Line {
            normal,
            offset: rho + origin.dot(normal),
        };
        let Some(line) = refine(start, group) else {
            continue;
        };
        let known = lines.iter().any(|other: &Line| {
            nearly_parallel(other, &line)
                && other
                    .distance(origin - line.normal * line.distance(origin))
                    .abs()
                    < 3.0
        });
        if !known {
            lines.push(line);
        }
    }
    lines
}

/// Refits a line twice to the points near it, by least squares of the perpendicular distance; `None` for few points
fn refine(mut line: Line, group: &[EdgePoint]) -> Option<Line> {
    for near in [2.0, 1.0] {
        let on: Vec<DVec2> = group
            .iter()
            .filter(|p| line.distance(p.position).abs() < near)
            .filter(|p| p.normal.dot(line.normal).abs() > 0.9)
            .map(|p| p.position)
            .collect();
        line = through(&on)?;
    }
    Some(line)
}

/// Returns whether corners are those of a card whose sides are edges
fn check(corners: &[DVec2; 4], group: &[EdgePoint]) -> Option<Card> {
    let sides: [DVec2; 4] = std::array::from_fn(|i| corners[(i + 1) % 4] - corners[i]);
    let turns = (0..4).map(|i| sides[i].perp_dot(sides[(i + 1) % 4]));
    let (positive, negative) = (
        turns.clone().all(|t| t > 0.0),
        turns.clone().all(|t| t < 0.0),
    );
    if !positive && !negative {
        return None;
    }
    for i in 0..2 {
        let ratio = sides[i].length() / sides[i + 2].length();
        if !(1.0 / MAX_SIDE_RATIO..MAX_SIDE_RATIO).contains(&ratio) {
            return None;
        }
    }
    let means = [0, 1].map(|i| (sides[i] - sides[i + 2]) / 2.0);
    let (long, short) = if means[0].length() >= means[1].length() {
        (means[0], means[1])
    } else {
        (means[1], means[0])
    };
    let (largest, smallest) = singular_values(long / CARD_MM[0], short / CARD_MM[1]);
    let tilt_degrees = (smallest / largest).clamp(0.0, 1.0).acos().to_degrees();
    if tilt_degrees > MAX_TILT_DEGREES {
        return None;
    }
    let px_per_mm = largest;
    let seen: [SideEdges; 4] = std::array::from_fn(|i| {
        let (from, to) = (corners[i], corners[(i + 1) % 4]);
        SideEdges::find(from, to, CORNER_MM * px_per_mm, group)
    });
    // Another edge, such as the person's, can take the place of a side. The sides next to it then end short of it; of a
    // card, fingers hide at most one of both ends.
    let reached = |i: usize| seen[(i + 3) % 4].ends[1] || seen[(i + 1) % 4].ends[0];
    if !(0..4).all(reached) {
        return None;
    }
    let coverage = seen.iter().map(|side| side.coverage).fold(1.0, f64::min);
    (coverage >= MIN_COVERAGE).then_some(Card {
        corners: *corners,
        mm_per_px: 1.0 / largest,
        tilt_degrees,
        coverage,
    })
}

/// Returns the larger and the smaller singular value of the matrix with these columns
fn singular_values(a: DVec2, b: DVec2) -> (f64, f64) {
    let sum = a.length_squared() + b.length_squared();
    let product = a.perp_dot(b).abs();
    let root = (sum * sum / 4.0 - product * product).max(0.0).sqrt();
    let largest = (sum / 2.0 + root).sqrt();
    (largest, product / largest)
}

/// What of a side is seen as an edge
#[derive(Debug, Clone, Copy)]
struct SideEdges {
    /// Part of the side that has an edge along it, 0 to 1, rounded corners left out
    coverage: f64,
    /// Whether the edge reaches the rounded corner at the start and at the end
    ends: [bool; 2],
}

impl SideEdges {
    /// The edge points along a side, except for `corner_px` at either end
    fn find(from: DVec2, to: DVec2, corner_px: f64, group: &[EdgePoint]) -> Self {
        const NEAR_PX: f64 = 1.2;
        let length = from.distance(to);
        let along = (to - from) / length.max(1e-9);
        let steps = (length - 2.0 * corner_px).floor().max(1.0) as usize;
        let mut seen = vec![false; steps];
        for point in group {
            let d = point.position - from;
            let at = (d.dot(along) - corner_px).floor();
            if along.perp_dot(d).abs() < NEAR_PX
                && at >= 0.0
                && along.perp_dot(point.normal).abs() > 0.85
            {
                // An edge has one point per row or column: a slanted one leaves gaps of less than a px.
                for slot in [at as usize, at as usize + 1] {
                    if let Some(slot) = seen.get_mut(slot) {
                        *slot = true;
                    }
                }
            }
        }
        let end_count = ((END_MM / CORNER_MM * corner_px).ceil() as usize).clamp(1, steps);
        let any = |slots: &[bool]| slots.iter().any(|&s| s);
        Self {
            coverage: seen.iter().filter(|&&s| s).count() as f64 / steps as f64,
            ends: [any(&seen[..end_count]), any(&seen[steps - end_count..])],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use pirouette_synthetic::Random;
    use proptest::prelude::*;

    /// Joints of a person who is 1.65 m tall, head in the photo, feet below it
    fn person(mm_per_px: f64) -> [DVec2; 2] {
        [(200.0, 40.0), (240.0, 40.0 + 1500.0 / mm_per_px)].map(DVec2::from)
    }

    /// A wall with a person's bar, some noise, and perhaps a card
    struct Scene {
        mm_per_px: f64,
        center: DVec2,
        /// Rotation within the picture, tilt, and direction of the tilt's axis, in degrees
        turn: f64,
        tilt: f64,
        axis: f64,
        size_mm: [f64; 2],
        color: [f64; 3],
        wall: [f64; 3],
        seed: u64,
    }

    impl Scene {
        /// Projects a card point (mm from its middle) into a camera 2.5 m away
        fn see(&self, p: DVec2) -> DVec2 {
            let axis = DVec3::new(
                self.axis.to_radians().cos(),
                self.axis.to_radians().sin(),
                0.0,
            );
            let turned = DMat3::from_rotation_z(self.turn.to_radians()) * p.extend(0.0);
            let q = DMat3::from_axis_angle(axis, self.tilt.to_radians()) * turned;
            self.center + q.truncate() / (1.0 - q.z / 2500.0) / self.mm_per_px
        }

        fn render(&self) -> Photo {
            let [w, h] = self.size_mm.map(|s| s / 2.0);
            let corners = [(-w, -h), (w, -h), (w, h), (-w, h)].map(|p| self.see(p.into()));
            let inside = |p: DVec2| {
                (0..4).all(|i| (corners[(i + 1) % 4] - corners[i]).perp_dot(p - corners[i]) > 0.0)
            };
            let mut random = Random::new(self.seed);
            Photo::from_fn(420, 600, |x, y| {
                const FINE: usize = 4;
                let mut covered = 0;
                for i in 0..FINE * FINE {
                    let (i, j) = (i % FINE, i / FINE);
                    let fine = |k: usize| (k as f64 + 0.5) / FINE as f64;
                    let p = DVec2::new(x as f64 + fine(i), y as f64 + fine(j));
                    covered += usize::from(inside(p));
                }
                let share = covered as f64 / (FINE * FINE) as f64;
                let person = (190..250).contains(&x) && (30..580).contains(&y);
                std::array::from_fn(|c| {
                    let behind = if person {
                        70.0
                    } else {
                        self.wall[c] + 0.02 * y as f64
                    };
                    let level = behind + (self.color[c] - behind) * share;
                    (level + 3.0 * random.normal()).clamp(0.0, 255.0) as u8
                })
            })
        }
    }

    fn scene() -> Scene {
        Scene {
            mm_per_px: 1.8,
            center: DVec2::new(320.0, 250.0),
            turn: 0.0,
            tilt: 0.0,
            axis: 0.0,
            size_mm: CARD_MM,
            color: [235.0, 235.0, 230.0],
            wall: [120.0, 125.0, 130.0],
            seed: 1,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

        #[test]
        fn a_tilted_card_in_a_noisy_photo_gives_the_scale(
            mm_per_px in 0.8..2.1f64,
            turn in -90.0..90.0f64,
            tilt in 0.0..20.0f64,
            axis in 0.0..180.0f64,
            shift in prop::array::uniform2(-20.0..20.0f64),
            seed in 0u64..1000,
        ) {
            let scene = Scene {
                mm_per_px,
                center: DVec2::new(330.0, 250.0) + DVec2::from_array(shift),
                turn,
                tilt,
                axis,
                seed,
                ..scene()
            };
            let card = find_card(&scene.render(), &person(mm_per_px));
            prop_assert!(card.is_ok(), "{:?}", card);
            let error = card.as_ref().unwrap().mm_per_px / mm_per_px - 1.0;
            prop_assert!(error.abs() < 0.01, "{} {:?}", error, card);
        }

        #[test]
        fn other_rectangles_are_rejected(
            aspect in prop_oneof![0.9..1.35f64, 1.9..4.0f64],
            turn in -90.0..90.0f64,
            mm_per_px in 0.8..2.1f64,
        ) {
            let scene = Scene {
                mm_per_px,
                turn,
                size_mm: [85.6, 85.6 / aspect],
                ..scene()
            };
            let found = find_card(&scene.render(), &person(mm_per_px));
            prop_assert_eq!(found, Err(CardError::NotFound));
        }
    }

    #[test]
    fn the_edge_of_a_person_is_no_side_of_a_rectangle_beside_it() {
        // 16 px beside the bar, with which it would have the shape of a card tilted by 21 degrees
        let scene = Scene {
            mm_per_px: 0.8,
            size_mm: [85.6, 85.6 / 1.279_849_698_776_601],
            ..scene()
        };
        let found = find_card(&scene.render(), &person(scene.mm_per_px));
        assert_eq!(found, Err(CardError::NotFound));
    }

    #[test]
    fn a_blue_card_in_front_of_an_equally_bright_wall_is_found() {
        let scene = Scene {
            color: [60.0, 90.0, 190.0],
            wall: [115.0, 100.0, 95.0],
            turn: 12.0,
            ..scene()
        };
        let card = find_card(&scene.render(), &person(1.8)).unwrap();
        assert!((card.mm_per_px / 1.8 - 1.0).abs() < 0.01, "{card:?}");
        assert!(card.tilt_degrees < 12.0, "{card:?}");
    }

    #[test]
    fn missing_cards_missing_people_and_implausible_cards_are_reported() {
        let without = Scene {
            size_mm: [0.0, 0.0],
            ..scene()
        };
        let photo = without.render();
        assert_eq!(find_card(&photo, &person(1.8)), Err(CardError::NotFound));
        assert_eq!(find_card(&photo, &[]), Err(CardError::NoPerson));
        assert_eq!(
            find_card(&photo, &[DVec2::NAN; 4]),
            Err(CardError::NoPerson)
        );
        // A poster of the same shape, far too large to be a card next to this person
        let poster = Scene {
            mm_per_px: 0.35,
            center: DVec2::new(335.0, 250.0),
            ..scene()
        };
        assert_eq!(
            find_card(&poster.render(), &person(1.8)),
            Err(CardError::NotFound)
        );
    }

    #[test]
    fn two_cards_of_different_sizes_are_rejected() {
        let (near, far) = (scene().render(), {
            Scene {
                mm_per_px: 1.4,
                center: DVec2::new(110.0, 300.0),
                ..scene()
            }
            .render()
        });
        let both = Photo::from_fn(
            420,
            600,
            |x, y| if x < 190 { far[(x, y)] } else { near[(x, y)] },
        );
        assert_eq!(find_card(&both, &person(1.8)), Err(CardError::Ambiguous));
    }
}
