//! Which parts of a person are covered, and the body below: normal distributions of the survey, and kinds of covering.
//!
//! The girths of a body are normally distributed around the survey's regressions on stature and mass, mass itself widely.
//! A seen girth is that of the body, or larger by the ease of a covering. All combinations of coverings of the parts are
//! compared by their probability given all seen girths; the body is the mean over them, weighted by it.

use pirouette_body::Sex;
use pirouette_body::survey::{Regression, correlation};

use super::super::prior::{RELAXED_OVER_FLEXED, dimension};
use super::super::{Estimate, Measure};
use super::Part;
use crate::scan::Looseness;

/// The girths and lengths of the model
pub(super) const MEASURES: [Measure; COUNT] = [
    Measure::WristGirth,
    Measure::ForearmGirth,
    Measure::BustGirth,
    Measure::WaistGirth,
    Measure::UpperArmGirth,
    Measure::HipGirth,
    Measure::ThighGirth,
    Measure::HeadGirth,
    Measure::NeckGirth,
    Measure::CalfGirth,
    Measure::AnkleGirth,
    Measure::FootLength,
];
const COUNT: usize = 12;
/// Number of parts
const PART_COUNT: usize = Part::ALL.len();

/// Standard deviation of a measure around the definition of the survey, as a share of it; the survey's waist is at the navel
fn definition_sd(measure: Measure) -> f64 {
    match measure {
        Measure::NeckGirth | Measure::WaistGirth | Measure::ForearmGirth => 0.04,
        Measure::ThighGirth
        | Measure::AnkleGirth
        | Measure::UpperArmGirth
        | Measure::WristGirth => 0.03,
        _ => 0.02,
    }
}

/// Standard deviation of people relative to that of the survey's soldiers, stature and mass being equal
const CIVILIANS: f64 = 1.2;

/// Body mass index of people of unknown mass: mean, and standard deviation of the square root of mass over stature
const MEAN_BMI: f64 = 25.5;
const BUILD_SD: f64 = 0.65;

/// Standard deviation of a stated mass, as a share of its square root, and the share of masses that are simply wrong
const STATED_BUILD_SD: f64 = 0.02;
const WRONG_MASS: f64 = 0.02;

/// Standard deviation of the stature, in m
const STATURE_SD_M: f64 = 0.012;

/// Share of people who are in everyday clothes instead of tight ones or underwear, as they are asked to be
const EVERYDAY: f64 = 0.12;

/// A kind of covering of a part
#[derive(Debug, Clone, Copy)]
struct Cover {
    looseness: Looseness,
    /// Probability for people in tight clothes, and for those in everyday clothes
    share: [f64; 2],
    /// Mean and standard deviation of what it adds to each measure of the part, in mm
    ease_mm: &'static [[f64; 2]],
}

/// A part of the body that is covered as a whole
struct CoveredPart {
    part: Part,
    /// Range of its measures in [`MEASURES`]
    from: usize,
    to: usize,
    covers: &'static [Cover],
}

const fn bare(tight: f64, everyday: f64) -> Cover {
    Cover {
        looseness: Looseness::Tight,
        share: [tight, everyday],
        ease_mm: &[],
    }
}

const fn cover(looseness: Looseness, share: [f64; 2], ease_mm: &'static [[f64; 2]]) -> Cover {
    Cover {
        looseness,
        share,
        ease_mm,
    }
}

/// The parts and their coverings; eases by the cut of shirts and trousers for everyday wear
const PARTS: [CoveredPart; PART_COUNT] = [
    CoveredPart {
        part: Part::Top,
        from: 2,
        to: 5,
        covers: &[
            bare(0.97, 0.2),
            cover(
                Looseness::Normal,
                [0.029, 0.6],
                &[[60.0, 35.0], [80.0, 45.0], [40.0, 30.0]],
            ),
            cover(
                Looseness::Loose,
                [0.001, 0.2],
                &[[160.0, 80.0], [220.0, 110.0], [90.0, 60.0]],
            ),
        ],
    },
    CoveredPart {
        part: Part::Bottom,
        from: 5,
        to: 7,
        covers: &[
            bare(0.97, 0.2),
            cover(
                Looseness::Normal,
                [0.029, 0.6],
                &[[60.0, 35.0], [50.0, 30.0]],
            ),
            cover(
                Looseness::Loose,
                [0.001, 0.2],
                &[[170.0, 90.0], [130.0, 80.0]],
            ),
        ],
    },
    CoveredPart {
        part: Part::Forearm,
        from: 0,
        to: 2,
        covers: &[
            bare(0.99, 0.6),
            cover(Looseness::Loose, [0.01, 0.4], &[[60.0, 40.0], [50.0, 35.0]]),
        ],
    },
    CoveredPart {
        part: Part::Head,
        from: 7,
        to: 8,
        covers: &[
            bare(0.85, 0.75),
            cover(Looseness::Loose, [0.15, 0.25], &[[60.0, 50.0]]),
        ],
    },
    CoveredPart {
        part: Part::Neck,
        from: 8,
        to: 9,
        covers: &[
            bare(0.95, 0.6),
            cover(Looseness::Loose, [0.05, 0.4], &[[80.0, 110.0]]),
        ],
    },
    CoveredPart {
        part: Part::Calf,
        from: 9,
        to: 10,
        covers: &[
            bare(0.995, 0.5),
            cover(Looseness::Loose, [0.005, 0.5], &[[80.0, 60.0]]),
        ],
    },
    CoveredPart {
        part: Part::Ankle,
        from: 10,
        to: 11,
        covers: &[
            bare(0.95, 0.4),
            cover(Looseness::Loose, [0.05, 0.6], &[[70.0, 50.0]]),
        ],
    },
    CoveredPart {
        part: Part::Foot,
        from: 11,
        to: 12,
        covers: &[
            bare(0.94, 0.3),
            cover(Looseness::Loose, [0.06, 0.7], &[[22.0, 12.0]]),
        ],
    },
];

/// What is known of a person
pub(super) struct Person<'a> {
    /// Sexes that are possible
    pub sexes: &'a [Sex],
    pub stature_mm: f64,
    pub mass_kg: Option<f64>,
    /// Looseness of the clothes on top and bottom, where it is known
    pub known: [Option<Looseness>; 2],
    /// The seen girths in the order of [`MEASURES`], where they are known
    pub seen: [Option<Estimate>; COUNT],
}

/// The body below what is seen
#[derive(Debug, Clone)]
pub(super) struct Inferred {
    /// Mean and standard deviation of the body's measures, in the order of [`MEASURES`], in mm
    pub body: [Estimate; COUNT],
    /// Mean and standard deviation of the square root of mass in kg over stature in m
    pub build: [f64; 2],
    /// Probability of each looseness of each part, in the order of [`Part::ALL`] and [`Looseness::ALL`]
    pub shares: [[f64; 3]; PART_COUNT],
}

/// A normal distribution of the measures of a body and of its build, the last coordinate
#[derive(Clone)]
struct Normal {
    mean: [f64; COUNT + 1],
    covariance: [[f64; COUNT + 1]; COUNT + 1],
    /// Logarithm of the probability density of what was observed
    log_evidence: f64,
}

impl Normal {
    /// Returns the distribution of people of a sex, a stature and a build; `None` for a sex that the survey lacks
    fn of_people(sex: Sex, stature_mm: f64, build: [f64; 2]) -> Option<Self> {
        let mut rows = Vec::with_capacity(COUNT);
        for measure in MEASURES {
            let (name, factor) = survey_dimension(measure)?;
            rows.push((measure, name, factor, Regression::of(name, sex)?));
        }
        let [build_mean, build_sd] = build;
        let mass_kg = build_mean * build_mean * stature_mm / 1000.0;
        let mut normal = Self {
            mean: [build_mean; COUNT + 1],
            covariance: [[0.0; COUNT + 1]; COUNT + 1],
            log_evidence: 0.0,
        };
        normal.covariance[COUNT][COUNT] = build_sd * build_sd;
        for (i, &(measure, name, factor, row)) in rows.iter().enumerate() {
            let mean = factor * row.mean_mm(stature_mm, mass_kg);
            normal.mean[i] = mean;
            let by_build = factor * row.per_build();
            normal.covariance[i][COUNT] = by_build * build_sd * build_sd;
            normal.covariance[COUNT][i] = normal.covariance[i][COUNT];
            for (j, &(_, other_name, other_factor, other)) in rows.iter().enumerate() {
                let people = CIVILIANS
                    * CIVILIANS
                    * correlation(name, other_name, sex)?
                    * (factor * row.sd_mm)
                    * (other_factor * other.sd_mm);
                let of_build = by_build * other_factor * other.per_build() * build_sd * build_sd;
                let of_stature = factor
                    * row.per_m_stature()
                    * other_factor
                    * other.per_m_stature()
                    * STATURE_SD_M
                    * STATURE_SD_M;
                normal.covariance[i][j] = people + of_build + of_stature;
            }
            normal.covariance[i][i] += (definition_sd(measure) * mean).powi(2);
        }
        Some(normal)
    }

    /// Conditions on an observation of one coordinate: that of the body plus an ease
    fn observe(&mut self, index: usize, seen: Estimate, ease_mm: [f64; 2]) {
        let column = self.covariance[index];
        let variance = column[index] + seen.sd_mm.powi(2) + ease_mm[1].powi(2);
        let innovation = seen.value_mm - ease_mm[0] - self.mean[index];
        self.log_evidence -= 0.5 * (innovation * innovation / variance + variance.ln());
        for i in 0..=COUNT {
            let gain = column[i] / variance;
            self.mean[i] += gain * innovation;
            for (cell, other) in self.covariance[i].iter_mut().zip(&column) {
                *cell -= gain * other;
            }
        }
    }
}

/// Returns the survey's dimension for a measure and the factor on it
fn survey_dimension(measure: Measure) -> Option<(&'static str, f64)> {
    match measure {
        Measure::WaistGirth => Some(("waist_girth", 1.0)),
        Measure::ForearmGirth => Some(("forearm_flexed_girth", RELAXED_OVER_FLEXED)),
        _ => dimension(measure),
    }
}

/// Weighted sums over all combinations of coverings
struct Sums {
    /// Evidence of the first combination, by which all are scaled
    scale: f64,
    weight: f64,
    first: [f64; COUNT + 1],
    second: [f64; COUNT + 1],
    shares: [[f64; 3]; PART_COUNT],
}

impl Sums {
    fn add(&mut self, normal: &Normal, log_prior: f64, covers: &[Looseness; PART_COUNT]) {
        let log = normal.log_evidence + log_prior;
        if log > self.scale {
            // Keeps the largest weight at 1.
            let shrink = (self.scale - log).exp();
            self.scale = log;
            self.weight *= shrink;
            self.first.iter_mut().for_each(|sum| *sum *= shrink);
            self.second.iter_mut().for_each(|sum| *sum *= shrink);
            self.shares
                .iter_mut()
                .flatten()
                .for_each(|sum| *sum *= shrink);
        }
        let weight = (log - self.scale).exp();
        self.weight += weight;
        for i in 0..=COUNT {
            self.first[i] += weight * normal.mean[i];
            self.second[i] += weight * (normal.mean[i].powi(2) + normal.covariance[i][i]);
        }
        for (shares, looseness) in self.shares.iter_mut().zip(covers) {
            shares[*looseness as usize] += weight;
        }
    }
}

/// Probability of each looseness of top and bottom where it is known
fn known_shares(known: Looseness) -> [f64; 3] {
    match known {
        Looseness::Tight => [0.99, 0.01, 0.0],
        Looseness::Normal => [0.1, 0.8, 0.1],
        Looseness::Loose => [0.02, 0.18, 0.8],
    }
}

/// Logarithm of a probability; that of zero is finite, so that sums are
fn log(probability: f64) -> f64 {
    probability.max(1e-12).ln()
}

/// Follows all coverings of the parts from `depth` on
fn follow(
    person: &Person,
    normal: &Normal,
    log_shares: [f64; 2],
    covers: &mut [Looseness; PART_COUNT],
    depth: usize,
    sums: &mut Sums,
) {
    let Some(part) = PARTS.get(depth) else {
        let [tight, everyday] = log_shares;
        let most = tight.max(everyday);
        let log_prior = most + ((tight - most).exp() + (everyday - most).exp()).ln();
        sums.add(normal, log_prior, covers);
        return;
    };
    for cover in part.covers {
        let mut shares = cover.share;
        let known = match part.part {
            Part::Top => person.known[0],
            Part::Bottom => person.known[1],
            _ => None,
        };
        if let Some(known) = known {
            shares = [known_shares(known)[cover.looseness as usize]; 2];
        }
        let mut observed = normal.clone();
        for index in part.from..part.to {
            let ease_mm = cover.ease_mm.get(index - part.from);
            if let Some(seen) = person.seen[index] {
                observed.observe(index, seen, ease_mm.copied().unwrap_or_default());
            }
        }
        covers[depth] = cover.looseness;
        let log_shares = std::array::from_fn(|i| log_shares[i] + log(shares[i]));
        follow(person, &observed, log_shares, covers, depth + 1, sums);
    }
}

/// Infers the body below what is seen; `None` for sexes that the survey lacks
pub(super) fn infer(person: &Person) -> Option<Inferred> {
    let stature_m = person.stature_mm / 1000.0;
    let unknown = [(MEAN_BMI * stature_m).sqrt(), BUILD_SD];
    let builds = match person.mass_kg {
        None => vec![(1.0, unknown)],
        Some(mass_kg) => {
            let build = (mass_kg / stature_m).sqrt();
            let stated = [build, STATED_BUILD_SD * build];
            vec![(1.0 - WRONG_MASS, stated), (WRONG_MASS, unknown)]
        }
    };
    let everyday = match person.known {
        [None, None] => EVERYDAY,
        [Some(Looseness::Tight), Some(Looseness::Tight)] => 0.01,
        [Some(Looseness::Tight), None] | [None, Some(Looseness::Tight)] => 0.05,
        _ => 0.95,
    };
    let mut sums = Sums {
        scale: f64::NEG_INFINITY,
        weight: 0.0,
        first: [0.0; COUNT + 1],
        second: [0.0; COUNT + 1],
        shares: [[0.0; 3]; PART_COUNT],
    };
    for &sex in person.sexes {
        for &(share, build) in &builds {
            let normal = Normal::of_people(sex, person.stature_mm, build)?;
            let log_shares = [1.0 - everyday, everyday].map(|p| log(share * p));
            let mut covers = [Looseness::Tight; PART_COUNT];
            follow(person, &normal, log_shares, &mut covers, 0, &mut sums);
        }
    }
    let moments = |i: usize| {
        let mean = sums.first[i] / sums.weight;
        let variance = sums.second[i] / sums.weight - mean * mean;
        [mean, variance.max(0.0).sqrt()]
    };
    Some(Inferred {
        body: std::array::from_fn(|i| {
            let [value_mm, sd_mm] = moments(i);
            Estimate { value_mm, sd_mm }
        }),
        build: moments(COUNT),
        shares: sums
            .shares
            .map(|shares| shares.map(|sum| sum / sums.weight)),
    })
}
