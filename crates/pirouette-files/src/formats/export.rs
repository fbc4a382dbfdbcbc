//! Measurements for other programs: CSV, flat JSON, schema.org, FreeSewing, Seamly2D and Valentina.
//!
//! Unavailable measures are omitted in every format. Each format states its unit.

use std::fmt::Write;

use serde_json::{Map, Value, json};

use pirouette::measure::{Measure, Measurements};
use pirouette::sizes::ChartSex;

/// A format of other programs
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFormat {
    /// Flat JSON: value and standard deviation per measure
    Json,
    /// One row per measure
    Csv,
    /// JSON-LD with the terms of schema.org
    SchemaOrg,
    /// A measurement set of FreeSewing, YAML, mm
    FreeSewing,
    /// Individual measurements of Seamly2D and Valentina, cm
    Seamly2d,
}

impl ExportFormat {
    /// Returns the name of the file in a result folder
    pub fn file_name(self) -> &'static str {
        match self {
            ExportFormat::Json => "measurements.flat.json",
            ExportFormat::Csv => "measurements.csv",
            ExportFormat::SchemaOrg => "measurements.schema-org.json",
            ExportFormat::FreeSewing => "measurements.freesewing.yaml",
            ExportFormat::Seamly2d => "measurements.vit",
        }
    }

    /// Returns the name of a measure in this format; `None` if the format has no measure of the same definition
    pub fn name_of(self, measure: Measure) -> Option<&'static str> {
        match self {
            ExportFormat::Json | ExportFormat::Csv => Some(measure.name()),
            ExportFormat::SchemaOrg => schema_term(measure, None),
            ExportFormat::FreeSewing => freesewing_name(measure),
            ExportFormat::Seamly2d => seamly_name(measure),
        }
    }

    /// Returns the content of the file
    pub fn write(self, measurements: &Measurements) -> String {
        match self {
            ExportFormat::Json => flat_json(measurements),
            ExportFormat::Csv => csv(measurements),
            ExportFormat::SchemaOrg => schema_org(measurements),
            ExportFormat::FreeSewing => freesewing(measurements),
            ExportFormat::Seamly2d => seamly(measurements),
        }
    }
}

fn tenths(value: f64) -> f64 {
    (value * 10.0).round() / 10.0
}

/// Returns the available values in mm; none if the scale is unknown
fn known(measurements: &Measurements) -> impl Iterator<Item = (Measure, f64, Option<f64>)> + '_ {
    let scaled = measurements.in_mm();
    measurements
        .iter()
        .filter(move |_| scaled)
        .filter_map(|(measure, found)| {
            let value_mm = found.value_mm.ok().filter(|v| v.is_finite())?;
            Some((measure, value_mm, found.sd_mm))
        })
}

fn flat_json(measurements: &Measurements) -> String {
    let mut values = Map::new();
    for (measure, value_mm, sd_mm) in known(measurements) {
        let entry = json!({ "mm": tenths(value_mm), "sd_mm": sd_mm.map(tenths) });
        values.insert(measure.name().to_owned(), entry);
    }
    if let Some(mass) = &measurements.mass {
        values.insert("body_mass".into(), json!({ "kg": tenths(mass.mass_kg) }));
        values.insert("volume".into(), json!({ "l": tenths(mass.volume_l) }));
    }
    format!("{:#}\n", Value::Object(values))
}

fn csv(measurements: &Measurements) -> String {
    let mut text = String::from("measure,value_mm,sd_mm,left_mm,right_mm,level_mm,definition\n");
    let cell = |value: Option<f64>| value.map_or(String::new(), |v| tenths(v).to_string());
    for (measure, value_mm, sd_mm) in known(measurements) {
        let found = measurements.get(measure);
        let definition = measure.definition().replace('"', "\"\"");
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},\"{definition}\"",
            measure.name(),
            tenths(value_mm),
            cell(sd_mm),
            cell(found.left_mm),
            cell(found.right_mm),
            cell(found.level_mm),
        );
    }
    text
}

/// Returns the term of schema.org's BodyMeasurementTypeEnumeration
fn schema_term(measure: Measure, sex: Option<ChartSex>) -> Option<&'static str> {
    Some(match measure {
        Measure::Stature => "BodyMeasurementHeight",
        Measure::NeckGirth => "BodyMeasurementNeck",
        Measure::BustGirth if sex == Some(ChartSex::Male) => "BodyMeasurementChest",
        Measure::BustGirth => "BodyMeasurementBust",
        Measure::UnderbustGirth => "BodyMeasurementUnderbust",
        Measure::WaistGirth => "BodyMeasurementWaist",
        Measure::HipGirth => "BodyMeasurementHips",
        Measure::CrotchHeight => "BodyMeasurementInsideLeg",
        Measure::HeadGirth => "BodyMeasurementHead",
        Measure::FootLength => "BodyMeasurementFoot",
        Measure::ShoulderToWrist => "BodyMeasurementArm",
        _ => return None,
    })
}

fn schema_org(measurements: &Measurements) -> String {
    let sex = measurements.subject.sex.and_then(ChartSex::of);
    let mut all: Vec<Value> = known(measurements)
        .filter_map(|(measure, value_mm, sd_mm)| {
            let term = schema_term(measure, sex)?;
            let mut entry = json!({
                "@type": "QuantitativeValue",
                "name": measure.name().replace('_', " "),
                "valueReference": format!("https://schema.org/{term}"),
                "value": tenths(value_mm),
                "unitCode": "MMT",
            });
            if let Some(sd_mm) = sd_mm {
                entry["minValue"] = json!(tenths(value_mm - sd_mm));
                entry["maxValue"] = json!(tenths(value_mm + sd_mm));
            }
            Some(entry)
        })
        .collect();
    if let Some(mass) = &measurements.mass {
        all.push(json!({
            "@type": "QuantitativeValue",
            "name": "weight",
            "valueReference": "https://schema.org/BodyMeasurementWeight",
            "value": tenths(mass.stated_kg.unwrap_or(mass.mass_kg)),
            "unitCode": "KGM",
        }));
    }
    let mut value = json!({
        "@context": "https://schema.org",
        "@type": "SizeSpecification",
        "suggestedMeasurement": all,
    });
    if let Some(sex) = sex {
        value["suggestedGender"] = json!(match sex {
            ChartSex::Female => "https://schema.org/Female",
            ChartSex::Male => "https://schema.org/Male",
        });
    }
    format!("{value:#}\n")
}

/// Returns the name in FreeSewing; its `hips` are at the waist of trousers, and are none of our measures
fn freesewing_name(measure: Measure) -> Option<&'static str> {
    Some(match measure {
        Measure::AnkleGirth => "ankle",
        Measure::UpperArmGirth => "biceps",
        Measure::BustSpan => "bustSpan",
        Measure::BustGirth => "chest",
        Measure::Rise => "crossSeam",
        Measure::FrontRise => "crossSeamFront",
        Measure::HeadGirth => "head",
        Measure::OverbustGirth => "highBust",
        Measure::SideNeckToBust => "hpsToBust",
        Measure::FrontLength => "hpsToWaistFront",
        Measure::CrotchHeight => "inseam",
        Measure::KneeGirth => "knee",
        Measure::NeckGirth => "neck",
        Measure::HipGirth => "seat",
        Measure::UpperArmLength => "shoulderToElbow",
        Measure::ShoulderWidth => "shoulderToShoulder",
        Measure::ShoulderToWrist => "shoulderToWrist",
        Measure::UnderbustGirth => "underbust",
        Measure::ThighGirth => "upperLeg",
        Measure::WaistGirth => "waist",
        Measure::WaistHeight => "waistToFloor",
        Measure::WaistToKnee => "waistToKnee",
        Measure::WaistToHip => "waistToSeat",
        Measure::BodyRise => "waistToUpperLeg",
        Measure::WristGirth => "wrist",
        _ => return None,
    })
}

/// Writes measurements by their FreeSewing names
fn freesewing(measurements: &Measurements) -> String {
    let value = |measure| {
        let mut all = known(measurements);
        all.find(|(m, _, _)| *m == measure).map(|(_, v, _)| v)
    };
    let named = known(measurements)
        .filter_map(|(measure, value_mm, _)| Some((freesewing_name(measure)?, value_mm)));
    let mut rows: Vec<(&str, f64)> = named.collect();
    let pair = value(Measure::UnderbustHeight).zip(value(Measure::WaistHeight));
    rows.extend(pair.map(|(underbust, waist)| ("waistToUnderbust", underbust - waist)));
    rows.sort_unstable_by_key(|(name, _)| *name);
    let mut text = String::from("name: pirouette\nunits: metric\nmeasurements:\n");
    for (name, value) in &rows {
        let _ = writeln!(text, "  {name}: {}", tenths(*value));
    }
    if rows.is_empty() {
        text = text.replace("measurements:\n", "measurements: {}\n");
    }
    text
}

/// Returns the name in Seamly2D and Valentina
fn seamly_name(measure: Measure) -> Option<&'static str> {
    Some(match measure {
        Measure::Stature => "height",
        Measure::NeckGirth => "neck_circ",
        Measure::BustGirth => "bust_circ",
        Measure::UnderbustGirth => "lowbust_circ",
        Measure::WaistGirth => "waist_circ",
        Measure::HipGirth => "hip_circ",
        Measure::HeadGirth => "head_circ",
        Measure::ThighGirth => "leg_thigh_upper_circ",
        Measure::KneeGirth => "leg_knee_circ",
        Measure::CalfGirth => "leg_calf_circ",
        Measure::AnkleGirth => "leg_ankle_high_circ",
        Measure::UpperArmGirth => "arm_upper_circ",
        Measure::WristGirth => "arm_wrist_circ",
        Measure::CrotchHeight => "leg_crotch_to_floor",
        Measure::BustHeight => "height_bustpoint",
        Measure::WaistHeight => "height_waist_side",
        Measure::HipHeight => "height_hip",
        Measure::Rise => "crotch_length",
        Measure::NapeToWaist => "neck_back_to_waist_b",
        Measure::ShoulderToWrist => "arm_shoulder_tip_to_wrist",
        Measure::ShoulderWidth => "shoulder_tip_to_shoulder_tip_b",
        Measure::FootLength => "foot_length",
        Measure::OverbustGirth => "highbust_circ",
        Measure::HighHipGirth => "highhip_circ",
        Measure::MidThighGirth => "leg_thigh_mid_circ",
        Measure::LowerKneeGirth => "leg_knee_small_circ",
        Measure::ElbowGirth => "arm_elbow_circ",
        Measure::ForearmGirth => "arm_lower_circ",
        Measure::NapeHeight => "height_neck_back",
        Measure::ShoulderHeight => "height_shoulder_tip",
        Measure::KneeHeight => "height_knee",
        Measure::ShoulderLength => "shoulder_length",
        Measure::UpperArmLength => "arm_shoulder_tip_to_elbow",
        Measure::AcrossBack => "across_back_b",
        Measure::AcrossFront => "across_chest_f",
        Measure::BustSpan => "bustpoint_to_bustpoint",
        Measure::SideNeckToBust => "neck_side_to_bust_f",
        Measure::FrontLength => "neck_side_to_waist_bustpoint_f",
        Measure::WaistToHip => "waist_to_hip_side",
        Measure::FrontRise => "crotch_length_f",
        Measure::BackRise => "crotch_length_b",
        Measure::ArmLength
        | Measure::BackLength
        | Measure::NarrowestWaistGirth
        | Measure::NarrowestWaistHeight
        | Measure::UnderbustHeight
        | Measure::BodyRise
        | Measure::WaistToKnee
        | Measure::NapeToWrist => return None,
    })
}

fn seamly(measurements: &Measurements) -> String {
    let gender = match measurements.subject.sex.and_then(ChartSex::of) {
        Some(ChartSex::Female) => "female",
        Some(ChartSex::Male) => "male",
        None => "unknown",
    };
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<vit>\n    <version>0.3.3</version>\n    <read-only>false</read-only>\n    \
         <notes/>\n    <unit>cm</unit>\n    <pm_system>998</pm_system>\n    <personal>\n        <family-name/>\n        \
         <given-name/>\n        <birth-date>1800-01-01</birth-date>\n        <gender>{gender}</gender>\n        <email/>\n    \
         </personal>\n    <body-measurements>\n"
    );
    for (measure, value_mm, _) in known(measurements) {
        if let Some(name) = seamly_name(measure) {
            let value_cm = (value_mm * 10.0).round() / 100.0;
            let _ = writeln!(text, "        <m name=\"{name}\" value=\"{value_cm}\"/>");
        }
    }
    text.push_str("    </body-measurements>\n</vit>\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette::measure::{MeasureInput, measure};
    use pirouette::scan::Subject;
    use pirouette_body::Sex;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    const ALL: [ExportFormat; 5] = [
        ExportFormat::Json,
        ExportFormat::Csv,
        ExportFormat::SchemaOrg,
        ExportFormat::FreeSewing,
        ExportFormat::Seamly2d,
    ];

    fn measured(stature_mm: Option<f64>) -> Measurements {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        measure(&MeasureInput {
            stature_mm,
            subject: Subject {
                sex: Some(Sex::Female),
                ..Subject::default()
            },
            ..MeasureInput::of_avatar(&avatar)
        })
    }

    #[test]
    fn every_format_contains_the_waist_under_its_name() {
        let all = measured(Some(1700.0));
        let waist_mm = tenths(all.value_mm(Measure::WaistGirth).unwrap());
        for (format, expected) in ALL.into_iter().zip([
            format!("\"mm\": {waist_mm:?}"),
            format!("waist_girth,{waist_mm},"),
            "https://schema.org/BodyMeasurementWaist".to_owned(),
            format!("  waist: {waist_mm}\n"),
            "<m name=\"waist_circ\" value=\"".to_owned(),
        ]) {
            let text = format.write(&all);
            assert!(text.contains(&expected), "{expected} in {text}");
        }
    }

    #[test]
    fn json_parses_and_xml_tags_are_balanced() {
        let all = measured(Some(1700.0));
        let flat: Value = serde_json::from_str(&ExportFormat::Json.write(&all)).unwrap();
        assert!(flat["hip_girth"]["mm"].as_f64().unwrap() > 500.0);
        let schema: Value = serde_json::from_str(&ExportFormat::SchemaOrg.write(&all)).unwrap();
        assert_eq!(schema["suggestedGender"], "https://schema.org/Female");
        let terms = schema["suggestedMeasurement"].as_array().unwrap();
        assert!(terms.iter().all(|t| t["value"].is_number()));
        let vit = ExportFormat::Seamly2d.write(&all);
        assert_eq!(vit.matches("<m name=").count(), 41);
        assert!(vit.trim_end().ends_with("</vit>"));
        let csv = ExportFormat::Csv.write(&all);
        let known = all.iter().filter(|(_, found)| found.value_mm.is_ok());
        assert_eq!(csv.lines().count(), 1 + known.count());
    }

    #[test]
    fn without_a_scale_there_are_no_values_in_mm() {
        let all = measured(None);
        for format in ALL {
            let text = format.write(&all);
            assert!(!text.contains("waist"), "{text}");
        }
    }
}
