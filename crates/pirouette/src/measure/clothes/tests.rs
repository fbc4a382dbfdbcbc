use super::model::{Inferred, MEASURES, Person, infer};
use super::*;
use crate::measure::{Measurements, measure};
use pirouette_body::Avatar;
use pirouette_body::mannequin::{MannequinParameters, mannequin};

/// Girths of a woman of 1650 mm and 62 kg, near the means of the survey, in the order of the model
const WOMAN_MM: [f64; 12] = [
    152.0, 250.0, 925.0, 815.0, 285.0, 995.0, 592.0, 558.0, 327.0, 368.0, 217.0, 247.0,
];

const STATURE_MM: f64 = 1650.0;
const MASS_KG: f64 = 64.0;

fn index(measure: Measure) -> usize {
    let found = MEASURES.iter().position(|other| *other == measure);
    found.expect("a measure of the model")
}

fn seen(girths_mm: [f64; 12]) -> [Option<Estimate>; 12] {
    girths_mm.map(|value_mm| {
        Some(Estimate {
            value_mm,
            sd_mm: 0.008 * value_mm,
        })
    })
}

/// Infers a woman's body from seen girths
fn inferred(girths_mm: [f64; 12], mass_kg: Option<f64>, stated: Option<StatedClothes>) -> Inferred {
    infer(&Person {
        sexes: &[Sex::Female],
        stature_mm: STATURE_MM,
        mass_kg,
        known: [stated.map(|s| s.top), stated.map(|s| s.bottom)],
        seen: seen(girths_mm),
    })
    .expect("the survey has women")
}

/// Adds ease to some of the girths
fn dressed(ease: &[(Measure, f64)]) -> [f64; 12] {
    let mut girths_mm = WOMAN_MM;
    for &(measure, ease_mm) in ease {
        girths_mm[index(measure)] += ease_mm;
    }
    girths_mm
}

const EVERYDAY_CLOTHES: [(Measure, f64); 7] = [
    (Measure::BustGirth, 60.0),
    (Measure::WaistGirth, 90.0),
    (Measure::UpperArmGirth, 40.0),
    (Measure::HipGirth, 60.0),
    (Measure::ThighGirth, 50.0),
    (Measure::CalfGirth, 90.0),
    (Measure::AnkleGirth, 80.0),
];

fn is_covered(inferred: &Inferred, part: Part) -> bool {
    Clothes::of(None, false, inferred).covers(part)
}

fn deviations(inferred: &Inferred) -> Vec<f64> {
    let body = inferred.body.iter().zip(WOMAN_MM);
    body.map(|(found, truth)| (found.value_mm - truth).abs() / found.sd_mm)
        .collect()
}

#[test]
fn a_body_in_tight_clothes_is_not_covered_at_any_build() {
    for factor in [0.85, 1.0, 1.2] {
        let girths_mm: [f64; 12] = std::array::from_fn(|i| match MEASURES[i] {
            Measure::HeadGirth | Measure::FootLength => WOMAN_MM[i],
            // Bones are thicker, too, but less.
            Measure::WristGirth | Measure::AnkleGirth => WOMAN_MM[i] * (1.0 + 0.5 * (factor - 1.0)),
            _ => WOMAN_MM[i] * factor,
        });
        let found = inferred(girths_mm, None, None);
        let covered: Vec<Part> = Part::ALL
            .into_iter()
            .filter(|part| is_covered(&found, *part))
            .collect();
        assert_eq!(covered, [], "{factor}: {:?}", found.shares);
        for (body, seen_mm) in found.body.iter().zip(girths_mm) {
            assert!(
                (body.value_mm / seen_mm - 1.0).abs() < 0.02,
                "{body:?} {seen_mm}"
            );
        }
    }
}

#[test]
fn hair_over_the_neck_changes_the_neck_alone() {
    let found = inferred(dressed(&[(Measure::NeckGirth, 210.0)]), None, None);
    for part in Part::ALL {
        assert_eq!(is_covered(&found, part), part == Part::Neck, "{part:?}");
    }
    let neck = found.body[index(Measure::NeckGirth)];
    assert!((neck.value_mm - WOMAN_MM[index(Measure::NeckGirth)]).abs() < 2.0 * neck.sd_mm);
    assert!((8.0..30.0).contains(&neck.sd_mm), "{neck:?}");
}

#[test]
fn hems_reveal_clothes_whose_girths_a_body_could_have() {
    let found = inferred(dressed(&EVERYDAY_CLOTHES), None, None);
    for part in [Part::Top, Part::Bottom, Part::Calf, Part::Ankle] {
        assert!(is_covered(&found, part), "{part:?}: {:?}", found.shares);
    }
    let off = deviations(&found);
    assert!(off.iter().all(|off| *off < 2.5), "{off:?}");
    let waist = found.body[index(Measure::WaistGirth)];
    assert!((20.0..70.0).contains(&waist.sd_mm), "{waist:?}");
}

#[test]
fn a_stated_mass_shows_the_body_below_loose_clothes() {
    let loose = dressed(&[
        (Measure::BustGirth, 180.0),
        (Measure::WaistGirth, 260.0),
        (Measure::UpperArmGirth, 90.0),
        (Measure::HipGirth, 150.0),
        (Measure::ThighGirth, 120.0),
        (Measure::CalfGirth, 120.0),
        (Measure::AnkleGirth, 110.0),
    ]);
    let found = inferred(loose, Some(MASS_KG), None);
    assert!(is_covered(&found, Part::Top) && is_covered(&found, Part::Bottom));
    for measure in [Measure::BustGirth, Measure::WaistGirth, Measure::HipGirth] {
        let body = found.body[index(measure)];
        let error = body.value_mm - WOMAN_MM[index(measure)];
        assert!(
            error.abs() < 60.0 && error.abs() < 2.0 * body.sd_mm,
            "{measure:?} {body:?}"
        );
    }
    let mass_kg = found.build[0].powi(2) * STATURE_MM / 1000.0;
    assert!((mass_kg - MASS_KG).abs() < 5.0, "{mass_kg}");
}

#[test]
fn a_statement_decides_what_the_girths_leave_open() {
    let seen_mm = dressed(&EVERYDAY_CLOTHES[..5]);
    let waist = |stated: Looseness| {
        let found = inferred(seen_mm, None, Some(StatedClothes::all(stated)));
        found.body[index(Measure::WaistGirth)]
    };
    let [tight, normal, loose] = Looseness::ALL.map(waist);
    let seen_waist_mm = seen_mm[index(Measure::WaistGirth)];
    assert!((tight.value_mm - seen_waist_mm).abs() < 5.0, "{tight:?}");
    assert!(normal.value_mm < tight.value_mm - 30.0, "{normal:?}");
    assert!(loose.value_mm < normal.value_mm - 10.0, "{loose:?}");
    assert!(tight.sd_mm < normal.sd_mm && normal.sd_mm < loose.sd_mm);
}

/// Measures an avatar as a photographed person whose body is wanted
fn measured(avatar: &Avatar, age_years: Option<f64>) -> Measurements {
    let mut input = MeasureInput::of_avatar(avatar);
    input.surface = Surface::Body;
    input.subject.age_years = age_years;
    measure(&input)
}

fn woman(stature_mm: f64) -> Avatar {
    mannequin(&MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(stature_mm),
        ..MannequinParameters::default()
    })
    .expect("a mannequin of this stature")
}

#[test]
fn measures_of_an_uncovered_avatar_stay_as_seen() {
    let avatar = woman(STATURE_MM);
    let body = measured(&avatar, None);
    let seen = measure(&MeasureInput::of_avatar(&avatar));
    let clothes = body.clothes.as_ref().expect("the survey holds");
    assert_eq!(clothes.covered().count(), 0, "{clothes:?}");
    for (measure, found) in body.iter() {
        assert_eq!(found, seen.get(measure), "{measure:?}");
    }
}

#[test]
fn the_survey_of_adults_is_not_used_for_children() {
    assert_eq!(measured(&woman(1350.0), None).clothes, None);
    assert_eq!(measured(&woman(STATURE_MM), Some(12.0)).clothes, None);
    assert!(measured(&woman(STATURE_MM), Some(40.0)).clothes.is_some());
}

/// Returns the measures of a woman of whom one is seen with an ease, the values of her body below, and what covers it
fn covered_more(eased: Measure, ease_mm: f64) -> (Measurements, Vec<(Measure, Measured)>, Clothes) {
    let avatar = woman(STATURE_MM);
    let input = MeasureInput {
        surface: Surface::Body,
        ..MeasureInput::of_avatar(&avatar)
    };
    let seen = measure(&MeasureInput::of_avatar(&avatar));
    let mut values: Vec<(Measure, Measured)> = seen.iter().map(|(m, v)| (m, *v)).collect();
    for (_, measured) in values.iter_mut().filter(|(m, _)| *m == eased) {
        measured.value_mm = measured.value_mm.map(|mm| mm + ease_mm);
    }
    let mut mass = seen.mass;
    let clothes = look_below(&input, &mut values, &mut mass).expect("the survey holds");
    (seen, values, clothes)
}

#[test]
fn a_covered_part_changes_only_its_measures_and_says_so() {
    let (seen, values, clothes) = covered_more(Measure::CalfGirth, 100.0);
    assert!(clothes.covers(Part::Calf), "{clothes:?}");
    for (measure, found) in &values {
        let covered = part_of(*measure).is_some_and(|part| clothes.covers(part));
        assert_eq!(found.method == Method::BelowClothes, covered, "{measure:?}");
        if covered {
            assert!(found.pixels.is_some());
            assert!(found.sd_mm > seen.get(*measure).sd_mm, "{measure:?}");
        } else {
            assert_eq!(found, seen.get(*measure), "{measure:?}");
        }
    }
}

#[test]
fn a_stated_sole_is_subtracted_from_heights_alone() {
    let avatar = woman(STATURE_MM);
    let barefoot = measure(&MeasureInput::of_avatar(&avatar));
    let mut input = MeasureInput::of_avatar(&avatar);
    input.subject.sole_mm = Some(30.0);
    let shod = measure(&input);
    for (measure, found) in shod.iter() {
        let less_mm = match measure.name() {
            "stature" => 30.0,
            name if name.ends_with("_height") => 30.0,
            _ => 0.0,
        };
        let expected = barefoot.value_mm(measure).map(|mm| mm - less_mm);
        assert_eq!(found.value_mm.ok(), expected, "{measure:?}");
    }
}

#[test]
fn shoes_of_unknown_thickness_widen_heights_and_the_scale() {
    let (seen, values, clothes) = covered_more(Measure::FootLength, 35.0);
    assert!(clothes.covers(Part::Foot), "{clothes:?}");
    let sd_mm = |wanted: Measure| {
        let (_, found) = values.iter().find(|(m, _)| *m == wanted).expect("present");
        found.sd_mm.expect("known")
    };
    assert!(sd_mm(Measure::CrotchHeight) > 15.0);
    assert!(sd_mm(Measure::HipGirth) > seen.get(Measure::HipGirth).sd_mm.expect("known"));
    assert_eq!(
        Some(sd_mm(Measure::Stature)),
        seen.get(Measure::Stature).sd_mm
    );
}
