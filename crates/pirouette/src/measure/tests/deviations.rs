//! Mass, statistics of a survey, and what widens the standard deviations.

use super::*;

#[test]
fn uncertain_keypoints_widen_the_standard_deviations_and_change_no_value() {
    let avatar = woman(1640.0);
    let measured = |[detected_keypoints, estimated_keypoints]: [f64; 2]| {
        measure(&MeasureInput {
            detected_keypoints,
            estimated_keypoints,
            extra_sd: ExtraSd::default(),
            ..input_of(&avatar, &[], BodySource::Fitted)
        })
    };
    let given = measured([0.0, 0.0]);
    for (uncertain, bust_share) in [([1.0, 0.0], 0.015), ([0.0, 1.0], 0.02)] {
        let uncertain = measured(uncertain);
        for ((measure, given), (_, uncertain)) in given.iter().zip(uncertain.iter()) {
            assert_eq!(given.value_mm, uncertain.value_mm);
            let wider = measure != Measure::Stature && given.sd_mm.is_some();
            assert_eq!(uncertain.sd_mm > given.sd_mm, wider, "{measure:?}");
        }
        let bust = uncertain.get(Measure::BustGirth);
        assert!(bust.sd_mm.unwrap() > bust_share * bust.value_mm.unwrap());
    }
}

#[test]
fn a_stature_of_stated_accuracy_scales_the_standard_deviations() {
    let avatar = woman(1640.0);
    let measured = |stature_sd_mm| {
        measure(&MeasureInput {
            subject: Subject {
                stature_sd_mm,
                ..Subject::default()
            },
            ..input_of(&avatar, &[], BodySource::Fitted)
        })
    };
    let (usual, sure, unsure) = (measured(None), measured(Some(2.0)), measured(Some(20.0)));
    let sd_mm = |found: &Measurements, measure| found.get(measure).sd_mm.unwrap();
    let of_stature = [&sure, &usual, &unsure].map(|found| sd_mm(found, Measure::Stature));
    assert_eq!(of_stature, [2.0, 12.0, 20.0]);
    let [sure_mm, unsure_mm] = [&sure, &unsure].map(|found| sd_mm(found, Measure::HipGirth));
    let hip_mm = usual.get(Measure::HipGirth).value_mm.unwrap();
    let added = (20.0_f64.powi(2) - 2.0_f64.powi(2)) * (hip_mm / 1640.0).powi(2);
    assert!((unsure_mm.powi(2) - sure_mm.powi(2) - added).abs() < 1e-6 * added);
}

#[test]
fn statistics_apply_only_with_given_sex_and_mass_and_are_reported() {
    let avatar = woman(1640.0);
    let plain = measured(&avatar, &[], BodySource::Fitted);
    let volume_kg = plain.mass.expect("there is a body").mass_kg;
    let with_mass = |mass_kg| {
        measure(&MeasureInput {
            stature_mm: Some(1640.0),
            subject: Subject {
                sex: Some(Sex::Female),
                mass_kg: Some(mass_kg),
                ..Subject::default()
            },
            ..input_of(&avatar, &[], BodySource::Fitted)
        })
    };
    let supported = with_mass(1.08 * volume_kg);
    let (before, after) = (
        plain.get(Measure::NeckGirth),
        supported.get(Measure::NeckGirth),
    );
    assert_eq!(after.method, Method::WithStatistics);
    assert_eq!(after.pixels.map(|p| p.value_mm), before.value_mm.ok());
    let prior = after.prior.expect("the survey includes necks").value_mm;
    let (low, high) = (
        prior.min(before.value_mm.unwrap()),
        prior.max(before.value_mm.unwrap()),
    );
    assert!((low..=high).contains(&after.value_mm.unwrap()));
    assert!(after.sd_mm < before.sd_mm);
    assert_eq!(supported.get(Measure::WaistGirth).prior, None);
    // A mass that the volume contradicts supports nothing.
    let contradicted = with_mass(1.3 * volume_kg);
    let doubted = contradicted.get(Measure::NeckGirth);
    assert_eq!((doubted.prior, doubted.value_mm), (None, before.value_mm));
    assert!(doubted.sd_mm > before.sd_mm);
}

#[test]
fn the_mass_follows_from_the_volume() {
    let avatar = woman(1640.0);
    let mass = measured(&avatar, &[], BodySource::Fitted)
        .mass
        .expect("there is a body");
    assert!((40.0..90.0).contains(&mass.mass_kg), "{mass:?}");
    let larger = measured(&avatar.scaled_to(1968.0), &[], BodySource::Fitted)
        .mass
        .unwrap();
    assert!((larger.volume_l / mass.volume_l / 1.728 - 1.0).abs() < 1e-6);
}
