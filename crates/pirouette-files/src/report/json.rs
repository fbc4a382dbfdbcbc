//! The content of `measurements.json`.

use pirouette::measure::{
    BodyMass, Clothes, Estimate, LengthUnit, Measure, Measured, Measurements,
};
use pirouette::scan::{StatedClothes, StatureFrom, Subject};
use pirouette::sizes::Advice;
use serde_json::{Map, Value, json};

/// Returns the content of `measurements.json`; `advice` are its sizes
///
/// `{ "measurements_mm": { key: number or null }, "details": { key: { .. } }, .. }`
pub fn measurements_json(measurements: &Measurements, advice: &[Advice]) -> Value {
    let unit = measurements.unit();
    let values = |unit: LengthUnit, known: bool| -> Map<String, Value> {
        let value = |m: &Measured| m.value_mm.ok().filter(|_| known).map(|v| unit.convert(v));
        let values = measurements.iter();
        values
            .map(|(measure, found)| (measure.name().to_owned(), json!(value(found))))
            .collect()
    };
    let details: Map<String, Value> = measurements
        .iter()
        .map(|(m, found)| (m.name().to_owned(), details(m, found, unit)))
        .collect();
    let mut file = json!({
        "measurements_mm": values(LengthUnit::Millimeter, measurements.in_mm()),
        "unit": if measurements.in_mm() { "mm" } else { "stature" },
        "scale": match measurements.stature {
            Some(StatureFrom::Stated) => "stature",
            Some(StatureFrom::Card) => "card",
            Some(StatureFrom::PixelSize) => "mm_per_px",
            Some(StatureFrom::Mesh) => "mesh",
            None => "unknown: give the stature, camera.mm_per_px, or --scale card",
        },
    });
    if !measurements.in_mm() {
        file["measurements_per_stature"] = Value::Object(values(unit, true));
    }
    if let Some(mass) = &measurements.mass {
        file["body"] = body_mass_json(mass);
    }
    let Subject {
        sex,
        mass_kg,
        age_years,
        stature_sd_mm,
        clothes,
        sole_mm,
    } = measurements.subject;
    if measurements.subject != Subject::default() {
        file["subject"] = json!({
            "sex": sex.map(|sex| sex.name()),
            "mass_kg": mass_kg,
            "age_years": age_years,
        });
        if let Some(sd_mm) = stature_sd_mm {
            file["subject"]["stature_sd_mm"] = json!(sd_mm);
        }
        if let Some(sole_mm) = sole_mm {
            file["subject"]["sole_mm"] = json!(sole_mm);
        }
        if let Some(StatedClothes { top, bottom }) = clothes {
            file["subject"]["clothes"] = json!({ "top": top, "bottom": bottom });
        }
    }
    if let Some(clothes) = &measurements.clothes {
        file["clothes"] = clothes_json(clothes);
    }
    if !advice.is_empty() {
        file["sizes"] = json!(advice);
    }
    file["details"] = Value::Object(details);
    file
}

/// Returns how loosely each part is covered, and with which probability
fn clothes_json(clothes: &Clothes) -> Value {
    let hundredths = |probability: f64| (100.0 * probability).round() / 100.0;
    let parts = clothes.coverings.iter().map(|covering| {
        let value = json!({
            "looseness": covering.looseness,
            "probability": hundredths(covering.probability),
            "covered": hundredths(covering.covered),
        });
        (covering.part.name().to_owned(), value)
    });
    let mut map: Map<String, Value> = parts.collect();
    map.insert("skirt".into(), json!(clothes.skirt));
    Value::Object(map)
}

/// Returns the details of one measure
fn details(measure: Measure, measured: &Measured, unit: LengthUnit) -> Value {
    let mut map = Map::new();
    map.insert("definition".into(), json!(measure.definition()));
    map.insert("method".into(), json!(measured.method));
    if let Err(why) = measured.value_mm {
        map.insert("missing".into(), json!(why.to_string()));
    }
    for (key, value) in [
        ("left", measured.left_mm),
        ("right", measured.right_mm),
        ("level", measured.level_mm),
        ("sd", measured.sd_mm),
        ("scale_sd", measured.scale_sd_mm),
    ] {
        if let Some(value) = value {
            map.insert(
                format!("{key}{}", unit.suffix()),
                json!(unit.convert(value)),
            );
        }
    }
    if let Some(views) = measured.view_count {
        map.insert("views".into(), json!(views));
    }
    for (key, estimate) in [
        ("support_lines", measured.lines),
        ("body_tape", measured.body),
        ("pixels", measured.pixels),
        ("prior", measured.prior),
    ] {
        if let Some(Estimate { value_mm, sd_mm }) = estimate {
            let (suffix, value, sd) = (unit.suffix(), unit.convert(value_mm), unit.convert(sd_mm));
            let entry = [(&suffix[1..], value), (&format!("sd{suffix}")[..], sd)];
            let entry = entry.map(|(key, value)| (key.to_owned(), json!(value)));
            map.insert(key.into(), Value::Object(Map::from_iter(entry)));
        }
    }
    if measured.contradicted {
        map.insert("contradicted".into(), json!(true));
    }
    Value::Object(map)
}

fn body_mass_json(mass: &BodyMass) -> Value {
    let tenths = |value: f64| (value * 10.0).round() / 10.0;
    json!({
        "volume_l": tenths(mass.volume_l),
        "volume_sd_l": tenths(mass.volume_sd_l),
        "mass_kg": tenths(mass.mass_kg),
        "mass_sd_kg": tenths(mass.mass_sd_kg),
        "stated_mass_kg": mass.stated_kg,
    })
}
