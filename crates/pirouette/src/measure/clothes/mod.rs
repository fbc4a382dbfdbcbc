//! Clothes, hair and shoes: which parts of a person they cover, and the measures of the body below.
//!
//! Outlines show what a person wears. A girth that no body has with the others, the stature and the mass is that of a garment
//! or of hair; so may be a plausible one. `model` computes for each part how loosely it is covered and what the body below
//! measures, by the distribution of body measures in a survey. Where a covering is likely enough, the estimates replace the
//! measures, with their standard deviations, which are several times as large.
//!
//! # Source
//! Survey: [`pirouette_body::survey`]. The estimate is a mean over models (Hoeting et al. 1999, *Bayesian model averaging: a
//! tutorial*, Statistical Science 14).

mod model;

use pirouette_body::Sex;
use pirouette_body::survey::holds_for;

use crate::scan::{Looseness, StatedClothes};

use super::lengths::is_above_floor;
use super::{BodyMass, Estimate, Measure, MeasureInput, Measured, Method};
use model::{Inferred, MEASURES, Person, infer};

/// A part of the body that clothes, hair or shoes cover as a whole
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum Part {
    /// Trunk down to the waist, and upper arms
    Top,
    /// Hips and thighs
    Bottom,
    Forearm,
    Head,
    Neck,
    Calf,
    Ankle,
    Foot,
}

impl Part {
    /// All parts
    pub const ALL: [Part; 8] = [
        Part::Top,
        Part::Bottom,
        Part::Forearm,
        Part::Head,
        Part::Neck,
        Part::Calf,
        Part::Ankle,
        Part::Foot,
    ];

    /// Returns the name used in files
    pub fn name(self) -> &'static str {
        match self {
            Part::Top => "top",
            Part::Bottom => "bottom",
            Part::Forearm => "forearm",
            Part::Head => "head",
            Part::Neck => "neck",
            Part::Calf => "calf",
            Part::Ankle => "ankle",
            Part::Foot => "foot",
        }
    }
}

/// The surface whose measures are reported
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Surface {
    /// The body, below the clothes
    #[default]
    Body,
    /// What the photos show, clothes and hair included
    Clothed,
}

/// Most likely covering of a part
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covering {
    /// The part
    pub part: Part,
    /// How loosely it is covered
    pub looseness: Looseness,
    /// Probability of this looseness
    pub probability: f64,
    /// Probability that it is covered more than tightly
    pub covered: f64,
}

/// The clothes of a person as far as they change measures
#[derive(Debug, Clone, PartialEq)]
pub struct Clothes {
    /// What the person states
    pub stated: Option<StatedClothes>,
    /// Whether it is a skirt or a dress
    pub skirt: bool,
    /// The coverings of all parts, in the order of [`Part::ALL`]
    pub coverings: Vec<Covering>,
}

impl Clothes {
    /// Returns the covering of a part; `None` for a part without one
    pub fn covering(&self, part: Part) -> Option<&Covering> {
        self.coverings.iter().find(|covering| covering.part == part)
    }

    fn of(stated: Option<StatedClothes>, skirt: bool, inferred: &Inferred) -> Self {
        let covering = |(part, shares): (Part, [f64; 3])| {
            let most =
                |a: &Looseness, b: &Looseness| shares[*a as usize].total_cmp(&shares[*b as usize]);
            let looseness = Looseness::ALL.into_iter().max_by(most);
            let looseness = looseness.unwrap_or(Looseness::Tight);
            Covering {
                part,
                looseness,
                probability: shares[looseness as usize],
                covered: 1.0 - shares[Looseness::Tight as usize],
            }
        };
        let parts = Part::ALL.into_iter().zip(inferred.shares);
        Self {
            stated,
            skirt,
            coverings: parts.map(covering).collect(),
        }
    }

    /// Returns the coverings whose measures are estimates of the body below
    pub fn covered(&self) -> impl Iterator<Item = &Covering> {
        let coverings = self.coverings.iter();
        let everyday = self.skirt || self.stated.is_some_and(|stated| !stated.is_tight());
        let least = MIN_COVERED[usize::from(everyday)];
        coverings.filter(move |covering| covering.covered > least)
    }

    /// Returns whether a part is covered likely enough for its measures to be estimates
    fn covers(&self, part: Part) -> bool {
        self.covered().any(|covering| covering.part == part)
    }
}

/// Probability of a covering from which on measures are replaced; below, the probability of a usual scan is noise
///
/// The second one is for people who are known to wear everyday clothes. In 68 scans of people in tight clothes, one
/// probability was above 0.25.
const MIN_COVERED: [f64; 2] = [0.3, 0.15];

/// Standard deviation of lengths over clothes, as a share of them: seams and landmarks are hidden
const LENGTH_SHARE: f64 = 0.03;

/// Standard deviation of heights due to shoes of unknown thickness, in mm
const UNKNOWN_SOLE_MM: f64 = 25.0;

/// Standard deviation of the height of hair above the crown, in mm
const HAIR_MM: f64 = 20.0;

/// Standard deviation of heights and lengths at the crotch below a skirt, as a share: only joints show where it is
const SKIRT_SHARE: f64 = 0.05;

/// Standard deviation of a girth derived from the one beside it, as a share
const DERIVED_SHARE: f64 = 0.03;

/// Returns the part that covers a measure; `None` where nothing does
pub(super) fn part_of(measure: Measure) -> Option<Part> {
    Some(match measure {
        Measure::BustGirth
        | Measure::UnderbustGirth
        | Measure::OverbustGirth
        | Measure::WaistGirth
        | Measure::NarrowestWaistGirth
        | Measure::UpperArmGirth
        | Measure::ElbowGirth
        | Measure::ShoulderWidth
        | Measure::ShoulderLength
        | Measure::AcrossBack
        | Measure::AcrossFront
        | Measure::BackLength
        | Measure::NapeToWaist
        | Measure::BustHeight
        | Measure::UnderbustHeight
        | Measure::BustSpan
        | Measure::SideNeckToBust
        | Measure::FrontLength
        | Measure::WaistHeight
        | Measure::NarrowestWaistHeight => Part::Top,
        Measure::HipGirth
        | Measure::HighHipGirth
        | Measure::ThighGirth
        | Measure::MidThighGirth
        | Measure::HipHeight
        | Measure::CrotchHeight
        | Measure::Rise
        | Measure::FrontRise
        | Measure::BackRise
        | Measure::BodyRise
        | Measure::WaistToHip => Part::Bottom,
        Measure::HeadGirth => Part::Head,
        Measure::NeckGirth => Part::Neck,
        Measure::KneeGirth | Measure::LowerKneeGirth | Measure::CalfGirth => Part::Calf,
        Measure::AnkleGirth => Part::Ankle,
        Measure::FootLength => Part::Foot,
        Measure::WristGirth | Measure::ForearmGirth => Part::Forearm,
        Measure::Stature
        | Measure::ArmLength
        | Measure::ShoulderToWrist
        | Measure::UpperArmLength
        | Measure::NapeToWrist
        | Measure::NapeHeight
        | Measure::ShoulderHeight
        | Measure::KneeHeight
        | Measure::WaistToKnee => return None,
    })
}

/// Returns the measure of the model that a girth beside it follows
fn beside(measure: Measure) -> Option<Measure> {
    Some(match measure {
        Measure::UnderbustGirth | Measure::OverbustGirth => Measure::BustGirth,
        Measure::NarrowestWaistGirth => Measure::WaistGirth,
        Measure::HighHipGirth => Measure::HipGirth,
        Measure::MidThighGirth => Measure::ThighGirth,
        Measure::KneeGirth | Measure::LowerKneeGirth => Measure::CalfGirth,
        Measure::ElbowGirth => Measure::UpperArmGirth,
        _ => return None,
    })
}

/// Replaces the measures of covered parts by those of the body below, and returns what covers them
///
/// Returns `None`, and changes nothing, where the survey does not hold, without a scale, and for [`Surface::Clothed`].
pub(super) fn look_below(
    input: &MeasureInput,
    values: &mut [(Measure, Measured)],
    mass: &mut Option<BodyMass>,
) -> Option<Clothes> {
    let subject = input.subject;
    let stature_mm = input.barefoot_mm()?;
    if input.surface == Surface::Clothed || !holds_for(stature_mm, subject.age_years) {
        return None;
    }
    let seen_value = |measure: Measure| {
        let (_, measured) = values.iter().find(|(other, _)| *other == measure)?;
        // Statistics of the survey would count twice.
        measured.pixels.or_else(|| measured.estimate())
    };
    let seen = MEASURES.map(seen_value);
    let sexes: &[Sex] = match subject.sex {
        Some(Sex::Female) => &[Sex::Female],
        Some(Sex::Male) => &[Sex::Male],
        Some(Sex::Neutral) | None => &[Sex::Female, Sex::Male],
    };
    let stated = subject.clothes;
    let bottom = match input.skirt {
        true => Some(Looseness::Loose),
        false => stated.map(|stated| stated.bottom),
    };
    let inferred = infer(&Person {
        sexes,
        stature_mm,
        mass_kg: subject.mass_kg,
        known: [stated.map(|stated| stated.top), bottom],
        seen,
    })?;
    let clothes = Clothes::of(stated, input.skirt, &inferred);
    // Estimates of the body, and their ratio to what is seen
    let below = |measure: Measure| {
        let index = MEASURES.iter().position(|other| *other == measure)?;
        let body = inferred.body[index];
        Some((body, seen[index].map(|seen| body.value_mm / seen.value_mm)))
    };
    for (measure, measured) in values.iter_mut() {
        let Some(part) = part_of(*measure).filter(|part| clothes.covers(*part)) else {
            continue;
        };
        let Some(visible) = measured.pixels.or_else(|| measured.estimate()) else {
            continue;
        };
        let of_beside = beside(*measure).and_then(below);
        let body = match (below(*measure), of_beside) {
            (Some((body, _)), _) => body,
            (None, Some((beside, Some(ratio)))) => {
                let value_mm = visible.value_mm * ratio;
                let share = (beside.sd_mm / beside.value_mm).hypot(DERIVED_SHARE);
                Estimate {
                    value_mm,
                    sd_mm: (visible.sd_mm * ratio).hypot(share * value_mm),
                }
            }
            // A height or a length: what is seen, less accurately
            _ => {
                let covered = clothes.covering(part).map_or(0.0, |found| found.covered);
                let share = match part {
                    Part::Bottom if input.skirt => SKIRT_SHARE,
                    _ => LENGTH_SHARE * covered,
                };
                *measured = measured.with_more_sd(|value_mm| share * value_mm);
                continue;
            }
        };
        measured.value_mm = Ok(body.value_mm);
        measured.sd_mm = Some(body.sd_mm.hypot(measured.scale_sd_mm.unwrap_or(0.0)));
        measured.method = Method::BelowClothes;
        measured.pixels = Some(visible);
        measured.prior = None;
        // Both sides are seen, not the body.
        measured.left_mm = None;
        measured.right_mm = None;
    }
    let covered = |part: Part| match clothes.covers(part) {
        true => clothes.covering(part).map_or(0.0, |found| found.covered),
        false => 0.0,
    };
    let sole_mm = match subject.sole_mm {
        Some(_) => 0.0,
        None => UNKNOWN_SOLE_MM * covered(Part::Foot),
    };
    let hair_mm = HAIR_MM * covered(Part::Head);
    for (measure, measured) in values.iter_mut() {
        if *measure != Measure::Stature {
            let above_floor_mm = match is_above_floor(*measure) {
                true => sole_mm,
                false => 0.0,
            };
            // The photographed height is that of the body with both: the scale depends on them.
            let taller = sole_mm.hypot(hair_mm) / stature_mm;
            *measured = measured.with_more_sd(|value_mm| above_floor_mm.hypot(taller * value_mm));
        }
    }
    if let Some(mass) = mass
        && (clothes.covers(Part::Top) || clothes.covers(Part::Bottom))
    {
        mass.set_build(inferred.build, stature_mm);
    }
    Some(clothes)
}

#[cfg(test)]
mod tests;
