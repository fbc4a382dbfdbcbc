//! Tables and page of the study.

use std::fmt::Write;

use pirouette::measure::Measure;
use serde_json::{Value, json};

use super::outcome::{Judged, MAX_DEVIATIONS, MEASURES, MIN_ERROR_MM, Measured, Outcome, name_of};
use super::{BMI, Case, Fault, FaultsOptions, FaultsStudy, Found, Strength};
use crate::table::{Cell, Table, percentile};

pub(super) fn write_study(
    options: &FaultsOptions,
    faults: &[Fault],
    found: &[Found],
) -> FaultsStudy {
    let tables = vec![
        outcomes(faults, found),
        deviations(faults, found),
        wrong(faults, found),
    ];
    FaultsStudy {
        views: options.views,
        captures: found.iter().map(|f| value(faults, f)).collect(),
        page: page(options, faults, found, &tables),
        tables,
    }
}

/// Returns whether a capture has no fault
fn is_healthy(faults: &[Fault], found: &Found) -> bool {
    faults[found.case.fault].group.is_none()
}

fn count(found: &[&Found], outcome: Outcome) -> usize {
    let of_outcome = found.iter().filter(|f| f.judged.outcome == outcome);
    of_outcome.count()
}

/// Returns the standard deviations of a measure relative to those of the same people without a fault
fn ratios(faults: &[Fault], all: &[Found], row: &[&Found], measure: Measure) -> Vec<f64> {
    let sd_mm = |found: &Found| {
        let of_measure = found.judged.measured.iter().find(|m| m.measure == measure);
        of_measure?.sd_mm
    };
    let usual_mm = |seed: u64| {
        let usual = all
            .iter()
            .find(|f| f.seed == seed && is_healthy(faults, f) && f.case.strength == Strength::Weak);
        sd_mm(usual?)
    };
    let ratio = |f: &&Found| Some(sd_mm(f)? / usual_mm(f.seed)?);
    row.iter().filter_map(ratio).collect()
}

/// Lists the outcomes of each fault in each strength
fn outcomes(faults: &[Fault], found: &[Found]) -> Table {
    let mut columns = vec!["fault", "strength", "people"];
    columns.extend(Outcome::ALL.map(Outcome::name));
    columns.push("SD ratio");
    let mut table = Table::new("outcomes", &columns);
    let mut add = |name: String, strength: &str, row: &[&Found]| {
        let mut cells = vec![
            Cell::Text(name),
            Cell::Text(strength.to_owned()),
            Cell::Number(row.len() as f64, 0),
        ];
        cells.extend(Outcome::ALL.map(|outcome| Cell::Number(count(row, outcome) as f64, 0)));
        let all = MEASURES.map(|measure| ratios(faults, found, row, measure));
        cells.push(Cell::number(percentile(&all.concat(), 0.5), 2));
        table.rows.push(cells);
    };
    for (index, fault) in faults.iter().enumerate() {
        for strength in Strength::ALL {
            let row: Vec<&Found> = found
                .iter()
                .filter(|f| f.case.fault == index && f.case.strength == strength)
                .collect();
            add(fault.name(), strength.pick(fault.strengths), &row);
        }
    }
    let faulty: Vec<&Found> = found.iter().filter(|f| !is_healthy(faults, f)).collect();
    add("all faults".to_owned(), "", &faulty);
    table
}

/// Compares errors with standard deviations, for measured captures with and without a fault
fn deviations(faults: &[Fault], found: &[Found]) -> Table {
    let mut table = Table::new(
        "errors of measured captures",
        &[
            "measure",
            "captures",
            "within 1 sd",
            "within 2 sd",
            "within 3 sd",
            "within 10 mm",
            "SD ratio",
            "without a fault",
            "then within 1 sd",
            "then within 2 sd",
            "then within 3 sd",
        ],
    );
    let measured: Vec<&Found> = found
        .iter()
        .filter(|f| f.judged.outcome != Outcome::Refused)
        .collect();
    let (healthy, faulty): (Vec<&Found>, Vec<&Found>) =
        measured.into_iter().partition(|f| is_healthy(faults, f));
    let mut add = |name: String, measures: &[Measure]| {
        let of = |row: &[&Found]| -> Vec<Measured> {
            let all = row.iter().flat_map(|f| f.judged.measured.clone());
            all.filter(|m| measures.contains(&m.measure)).collect()
        };
        let (with, without) = (of(&faulty), of(&healthy));
        let ratios: Vec<f64> = measures
            .iter()
            .flat_map(|&measure| ratios(faults, found, &faulty, measure))
            .collect();
        let mut cells = vec![Cell::Text(name), Cell::Number(with.len() as f64, 0)];
        cells.extend(within(&with));
        let small = share(&with, |m| m.error_mm().abs() <= MIN_ERROR_MM);
        cells.push(Cell::number(small, 0));
        cells.push(Cell::number(percentile(&ratios, 0.5), 2));
        cells.push(Cell::Number(without.len() as f64, 0));
        cells.extend(within(&without));
        table.rows.push(cells);
    };
    for measure in MEASURES {
        add(name_of(measure), &[measure]);
    }
    add("all".to_owned(), &MEASURES);
    table
}

fn within(measured: &[Measured]) -> [Cell; 3] {
    [1.0, 2.0, MAX_DEVIATIONS].map(|sd| Cell::number(share(measured, |m| m.within(sd)), 0))
}

/// Returns the percentage of values for which a condition holds
fn share(measured: &[Measured], condition: impl Fn(&Measured) -> bool) -> Option<f64> {
    let count = measured.iter().filter(|m| condition(m)).count() as f64;
    (!measured.is_empty()).then(|| 100.0 * count / measured.len() as f64)
}

/// Lists the wrong captures with their wrong measures
fn wrong(faults: &[Fault], found: &[Found]) -> Table {
    let mut table = Table::new(
        "wrong captures",
        &[
            "fault", "strength", "person", "camera", "errors", "overlap", "warnings",
        ],
    );
    let mut all: Vec<&Found> = found
        .iter()
        .filter(|f| f.judged.outcome == Outcome::Wrong)
        .collect();
    all.sort_by_key(|f| (f.case.fault, f.case.strength as usize));
    for f in all {
        let fault = &faults[f.case.fault];
        let camera = if f.states_camera { "stated" } else { "unknown" };
        table.rows.push(vec![
            Cell::Text(fault.name()),
            Cell::Text(f.case.strength.pick(fault.strengths).to_owned()),
            Cell::Text(f.person.clone()),
            Cell::Text(camera.to_owned()),
            Cell::Text(f.judged.wrong_measures()),
            Cell::number(f.judged.overlap, 3),
            Cell::Text(f.judged.warnings.join(" ")),
        ]);
    }
    table
}

fn page(options: &FaultsOptions, faults: &[Fault], found: &[Found], tables: &[Table]) -> String {
    let (healthy, faulty): (Vec<&Found>, Vec<&Found>) =
        found.iter().partition(|f| is_healthy(faults, f));
    let mut page = String::new();
    let _ = write!(
        page,
        "# Wrong input\n\n\
         `pirouette eval faults` generates this page. {} kinds of fault, each in three strengths, are applied to captures of {}\n\
         random people: women and men with body mass indices from {:.0} to {:.0}, {} photos of 800 x 1000 px, sway, noisy\n\
         keypoints and statures as in [accuracy.md](accuracy.md), and seeds that no other study uses. Half of the people state\n\
         field of view and height of the camera, the others neither. The files of each capture are scanned as by\n\
         `pirouette scan`.\n\n\
         The results should never contain a wrong value with a small standard deviation. Outcomes:\n\n\
         - refused: no measurements, but an error or a reason\n\
         - corrected: a warning states that the input was corrected or a view excluded, and all measures are right\n\
         - right: all measures are right, without a correction\n\
         - wrong: a measure is off by more than {MAX_DEVIATIONS:.0} of its reported standard deviations and more than {MIN_ERROR_MM:.0} mm\n\n\
         The measures are the girths of neck, bust, waist, hip, thigh and calf, and the crotch height. `SD ratio` is the median\n\
         of the reported standard deviations relative to those of the same person and measure without a fault. At least 68, 95\n\
         and 99 % of the errors should be within 1, 2 and 3 standard deviations.\n\n",
        faults.len() - 1,
        options.people,
        BMI.start(),
        BMI.end(),
        options.views,
    );
    for (name, row) in [("with a fault", &faulty), ("without a fault", &healthy)] {
        let [refused, corrected, right, wrong] = Outcome::ALL.map(|outcome| count(row, outcome));
        let _ = writeln!(
            page,
            "Of {} captures {name}, {refused} are refused, {corrected} corrected, {right} right and {wrong} wrong.",
            row.len()
        );
    }
    for table in tables {
        let _ = write!(page, "\n{}", table.to_section());
    }
    page.push_str(
        "\nErrors are in mm, ± the reported standard deviation; only wrong measures are listed. `overlap` is the mean\n\
         intersection over union of the body with the silhouettes.\n",
    );
    page
}

/// Returns one capture as JSON
fn value(faults: &[Fault], found: &Found) -> Value {
    // Much less than what the outcome depends on
    let rounded = |value: f64| (value * 1e4).round() / 1e4;
    let fault = &faults[found.case.fault];
    let judged = &found.judged;
    let mut value = json!({
        "person": found.person,
        "seed": found.seed,
        "group": fault.group.map(super::Group::name),
        "kind": fault.kind,
        "strength": found.case.strength.pick(fault.strengths),
        "camera_stated": found.states_camera,
        "outcome": judged.outcome.name(),
        "reason": judged.reason,
        "warnings": judged.warnings,
        "overlap": judged.overlap.map(|overlap| (overlap * 1e4).round() / 1e4),
    });
    for m in &judged.measured {
        value["measures"][m.measure.name()] = json!({
            "true_mm": rounded(m.true_mm),
            "value_mm": rounded(m.value_mm),
            "sd_mm": m.sd_mm.map(rounded),
        });
    }
    value
}

/// Reads a capture that [`value`] has written; `None` if the value is another, or of a fault that is not in `faults`
pub(super) fn read_capture(faults: &[Fault], value: &Value) -> Option<Found> {
    let text = |key: &str| value[key].as_str();
    let fault = faults.iter().position(|fault| {
        fault.group.map(super::Group::name) == text("group") && Some(fault.kind) == text("kind")
    })?;
    let of_strength =
        |strength: &Strength| Some(strength.pick(faults[fault].strengths)) == text("strength");
    let strength = Strength::ALL.into_iter().find(of_strength)?;
    let outcome = |outcome: &Outcome| Some(outcome.name()) == text("outcome");
    let warnings = value["warnings"].as_array()?.iter();
    let measured = |&measure: &Measure| {
        let found = value["measures"].get(measure.name())?;
        Some(Measured {
            measure,
            true_mm: found["true_mm"].as_f64()?,
            value_mm: found["value_mm"].as_f64()?,
            sd_mm: found["sd_mm"].as_f64(),
        })
    };
    Some(Found {
        person: text("person")?.to_owned(),
        seed: value["seed"].as_u64()?,
        states_camera: value["camera_stated"].as_bool()?,
        case: Case { fault, strength },
        judged: Judged {
            outcome: Outcome::ALL.into_iter().find(outcome)?,
            reason: text("reason").map(str::to_owned),
            warnings: warnings
                .filter_map(|w| w.as_str().map(str::to_owned))
                .collect(),
            overlap: value["overlap"].as_f64(),
            measured: MEASURES.iter().filter_map(measured).collect(),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Group, faults, join};
    use super::*;

    fn found(fault: usize, outcome: Outcome, error_mm: f64, sd_mm: f64) -> Found {
        Found {
            person: "person 1".to_owned(),
            seed: 1,
            states_camera: true,
            case: Case {
                fault,
                strength: Strength::Weak,
            },
            judged: Judged {
                outcome,
                reason: None,
                warnings: vec!["blurred".to_owned()],
                overlap: Some(0.97),
                measured: vec![Measured {
                    measure: Measure::WaistGirth,
                    true_mm: 800.0,
                    value_mm: 800.0 + error_mm,
                    sd_mm: Some(sd_mm),
                }],
            },
        }
    }

    #[test]
    fn outcomes_are_counted_and_wrong_ones_listed() {
        let faults = faults(&[Group::Masks]);
        let found = [
            found(0, Outcome::Right, 3.0, 4.0),
            found(1, Outcome::Wrong, -31.0, 8.0),
            found(1, Outcome::Right, 9.0, 12.0),
        ];
        let options = FaultsOptions {
            groups: vec![Group::Masks],
            ..FaultsOptions::default()
        };
        let study = write_study(&options, &faults, &found);
        for line in [
            "| none | photos | 1 | 0 | 0 | 1 | 0 | 1.00 |",
            "| masks: too wide | 1 px | 2 | 0 | 0 | 1 | 1 | 2.50 |",
            "| all faults |  | 2 | 0 | 0 | 1 | 1 | 2.50 |",
            "| waist girth | 2 | 50 | 50 | 50 | 50 | 2.50 | 1 | 100 | 100 | 100 |",
            "| masks: too wide | 1 px | person 1 | stated | waist girth -31 ± 8 | 0.970 | blurred |",
            "Of 2 captures with a fault, 0 are refused, 0 corrected, 1 right and 1 wrong.",
        ] {
            assert!(study.page.contains(line), "{line}\n{}", study.page);
        }
        assert_eq!(study.captures[1]["outcome"], "wrong");
        assert_eq!(study.captures[1]["measures"]["waist_girth"]["sd_mm"], 8.0);
        assert_eq!(study.captures[0]["group"], Value::Null);
    }

    #[test]
    fn a_study_joined_from_its_parts_is_the_whole() {
        let faults = faults(&Group::ALL);
        let of_person = |seed: u64| {
            let captures = [(0, Outcome::Right, 3.0), (4, Outcome::Wrong, -31.0)];
            captures.map(|(fault, outcome, error_mm)| Found {
                seed,
                person: format!("person {seed}"),
                ..found(fault, outcome, error_mm, 8.0)
            })
        };
        let options = FaultsOptions {
            people: 2,
            ..FaultsOptions::default()
        };
        let parts = [2, 1].map(|seed| {
            let study = write_study(&options, &faults, &of_person(seed));
            json!({ "views": 8, "captures": study.captures })
        });
        let whole = [1, 2].map(of_person).concat();
        let joined = join(&parts).unwrap();
        assert_eq!(joined.page, write_study(&options, &faults, &whole).page);

        let twice = [&parts[0], &parts[0]].map(Value::clone);
        for bad in [&twice[..], &[], &[json!({ "views": 8 })]] {
            assert!(join(bad).is_err());
        }
    }
}
