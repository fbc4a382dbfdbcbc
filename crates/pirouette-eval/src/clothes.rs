//! Scans of dressed people: the effect of clothes, shoes and hair on silhouettes and tape measures of the body below.

use pirouette::measure::{Measure, measure_avatar};
use pirouette::pipeline::{CancelToken, Config, Goal, Method, run};
use pirouette::scan::{Looseness, StatedClothes};
use pirouette_synthetic::wardrobe::{Hair, Outfit, dress};
use pirouette_synthetic::{Appearance, SyntheticOptions, synthesize_dressed};
use serde_json::{Value, json};

use crate::people::{PHOTO_SIZE_PX, Person};
use crate::table::{Cell, Table, mean};
use crate::{OnStep, StudyError, do_all};

/// Seed of the first person; no other study uses it or the following ones
pub const FIRST_SEED: u64 = 6001;

/// Thickness of the soles of the shoes, in mm
const SOLE_MM: f64 = 25.0;

/// Measures in the tables
const MEASURES: [Measure; 9] = [
    Measure::BustGirth,
    Measure::WaistGirth,
    Measure::HipGirth,
    Measure::ThighGirth,
    Measure::CalfGirth,
    Measure::NeckGirth,
    Measure::HeadGirth,
    Measure::Stature,
    Measure::CrotchHeight,
];

/// Options of the study
#[derive(Debug, Clone, PartialEq)]
pub struct ClothesOptions {
    /// Number of people, each in all outfits
    pub people: usize,
    /// Seed of the first person
    pub first_seed: u64,
    /// Photos per scan
    pub views: usize,
    /// Columns and rows of the photos
    pub photo_size_px: (usize, usize),
    /// Outfits with what is stated about them
    pub outfits: Vec<Worn>,
}

/// An outfit with what the person states about it
#[derive(Debug, Clone, PartialEq)]
pub struct Worn {
    /// Name for tables
    pub name: String,
    /// The outfit
    pub outfit: Outfit,
    /// Stated looseness of the clothes
    pub clothes: Option<StatedClothes>,
    /// Whether the thickness of the soles is stated
    pub sole: bool,
    /// Whether sex and mass are stated
    pub mass: bool,
}

impl Worn {
    fn new(name: &str, outfit: Outfit) -> Self {
        Self {
            name: name.to_owned(),
            outfit,
            clothes: None,
            sole: false,
            mass: false,
        }
    }
}

impl Default for ClothesOptions {
    fn default() -> Self {
        Self {
            people: 10,
            first_seed: FIRST_SEED,
            views: 8,
            photo_size_px: PHOTO_SIZE_PX,
            outfits: outfits(),
        }
    }
}

/// Returns the outfits of the study: tight clothes with each kind of hair and with shoes, then wider ones
pub fn outfits() -> Vec<Worn> {
    let tight = Outfit::tight();
    let with_hair = |hair: Hair| Worn::new(hair.name(), Outfit { hair, ..tight });
    let shod = Outfit {
        sole_mm: SOLE_MM,
        ..tight
    };
    let mut outfits: Vec<_> = Hair::ALL.into_iter().map(with_hair).collect();
    let stated = |name: &str, outfit: Outfit, looseness: Looseness| Worn {
        clothes: Some(StatedClothes::all(looseness)),
        ..Worn::new(name, outfit)
    };
    let (normal, loose) = (Outfit::normal(), Outfit::loose());
    outfits.extend([
        Worn::new("shoes", shod),
        Worn {
            sole: true,
            ..Worn::new("shoes, stated", shod)
        },
        Worn::new("normal clothes", normal),
        stated("normal clothes, stated", normal, Looseness::Normal),
        Worn::new("loose clothes", loose),
        stated("loose clothes, stated", loose, Looseness::Loose),
        Worn {
            mass: true,
            ..stated("loose clothes, stated with mass", loose, Looseness::Loose)
        },
        Worn::new("skirt", Outfit::skirt()),
    ]);
    outfits
}

/// Results of the study
#[derive(Debug, Clone)]
pub struct ClothesStudy {
    /// Silhouettes and calibration, and errors of the measures, a row for each outfit
    pub tables: Vec<Table>,
    /// Every person in every outfit, as JSON
    pub people: Value,
    /// The page, in Markdown
    pub page: String,
}

/// One measure of one scan
#[derive(Debug, Clone, Copy)]
struct Found {
    true_mm: f64,
    value_mm: f64,
    sd_mm: f64,
}

impl Found {
    fn error_mm(&self) -> f64 {
        self.value_mm - self.true_mm
    }
}

/// One person in one outfit
struct Scanned {
    /// Overlap with the true silhouette, of each photo; 0 for views without a silhouette
    overlaps: Vec<f64>,
    /// In the order of [`MEASURES`]
    found: [Option<Found>; MEASURES.len()],
    error: Option<String>,
    refusal: Option<String>,
}

/// Scans photographed people in all outfits
///
/// The true values are those of the same tapes on the naked body. The exact stature of the naked, barefoot body is stated.
/// True silhouettes contain clothes and hair.
///
/// # Errors
/// When there are no people, views or outfits, or the study was cancelled.
pub fn study(
    options: &ClothesOptions,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<ClothesStudy, StudyError> {
    let people: Vec<Person> = (0..options.people as u64)
        .filter_map(|index| Person::new(options.first_seed + index).ok())
        .collect();
    // Outfits of one person follow each other: an interrupted study has complete people.
    let jobs: Vec<(&Person, usize)> = people
        .iter()
        .flat_map(|person| (0..options.outfits.len()).map(move |outfit| (person, outfit)))
        .collect();
    if jobs.is_empty() || options.views == 0 {
        return Err(StudyError::Nothing);
    }
    let config = Config::new(Goal::Measure, Method::Fit);
    let scanned = do_all(&jobs, cancel, on_step, |&(person, outfit)| {
        let worn = &options.outfits[outfit];
        let name = &worn.name;
        let scanned = scan(person, worn, options, &config, cancel);
        let failure = scanned.error.as_ref().or(scanned.refusal.as_ref());
        let result = match failure {
            Some(text) => text.clone(),
            None => format!("overlap {:.3}", mean(&scanned.overlaps).unwrap_or(0.0)),
        };
        (scanned, format!("{name}, {}: {result}", person.describe()))
    })?;
    Ok(write_study(options, &jobs, &scanned))
}

fn scan(
    person: &Person,
    worn: &Worn,
    options: &ClothesOptions,
    config: &Config,
    cancel: &CancelToken,
) -> Scanned {
    let (width_px, height_px) = options.photo_size_px;
    let photography = SyntheticOptions {
        camera: SyntheticOptions::camera_for(person.avatar.stature_mm(), width_px, height_px),
        ..person.options(options.views, 1.0, true)
    };
    let dressed = dress(&person.avatar, &worn.outfit, person.seed);
    let mut synthetic = synthesize_dressed(&dressed, &photography, &Appearance::default());
    let scan = &mut synthetic.scan;
    scan.subject.clothes = worn.clothes;
    if worn.sole {
        let sole_mm = worn.outfit.sole_mm;
        scan.subject.sole_mm = Some(sole_mm);
        scan.stature_mm = scan.stature_mm.map(|barefoot| barefoot + sole_mm);
    }
    if worn.mass {
        let stature_m = person.avatar.stature_mm() / 1000.0;
        scan.subject.sex = Some(person.sex);
        scan.subject.mass_kg = Some(person.bmi * stature_m * stature_m);
    }
    let mut scanned = Scanned {
        overlaps: Vec::new(),
        found: [None; MEASURES.len()],
        error: None,
        refusal: None,
    };
    let report = match run(&synthetic.scan, config, cancel, &mut |_| {}) {
        Ok(report) => report,
        Err(error) => {
            scanned.error = Some(error.to_string());
            return scanned;
        }
    };
    scanned.refusal = report.refusal.as_ref().map(ToString::to_string);
    let silhouettes = synthetic.truth.silhouettes.iter().enumerate();
    scanned.overlaps = silhouettes
        .map(|(index, truth)| {
            let view = report.views.iter().find(|view| view.id.0 == index);
            view.map_or(0.0, |view| view.silhouette.mask.iou(truth))
        })
        .collect();
    let truth = measure_avatar(&person.avatar);
    scanned.found = MEASURES.map(|measure| {
        let measured = report.measurements.as_ref()?.get(measure);
        let (_, true_mm) = truth.iter().find(|(m, _)| *m == measure)?;
        Some(Found {
            true_mm: *true_mm,
            value_mm: measured.value_mm.ok()?,
            sd_mm: measured.sd_mm?,
        })
    });
    scanned
}

fn write_study(
    options: &ClothesOptions,
    jobs: &[(&Person, usize)],
    scanned: &[Scanned],
) -> ClothesStudy {
    let rows: Vec<(&str, Vec<&Scanned>)> = options
        .outfits
        .iter()
        .enumerate()
        .map(|(index, worn)| {
            let of_outfit = jobs.iter().zip(scanned).filter(|(job, _)| job.1 == index);
            (worn.name.as_str(), of_outfit.map(|(_, s)| s).collect())
        })
        .collect();
    let tables = vec![scans_table(&rows), errors_table(&rows), shares_table(&rows)];
    let people = jobs.iter().zip(scanned).map(|((person, outfit), scanned)| {
        person_value(person, &options.outfits[*outfit].name, scanned)
    });
    ClothesStudy {
        people: people.collect(),
        page: page(options, &tables),
        tables,
    }
}

/// Silhouettes, and calibration of all measures but the stature, which is stated
fn scans_table(rows: &[(&str, Vec<&Scanned>)]) -> Table {
    let mut table = Table::new(
        "scans of dressed people",
        &[
            "outfit",
            "people",
            "failed",
            "refused",
            "overlap",
            "worst overlap",
            "within 1 sd",
            "within 2 sd",
            "within 3 sd",
        ],
    );
    for (name, row) in rows {
        let count =
            |of: fn(&Scanned) -> bool| Cell::Number(row.iter().filter(|s| of(s)).count() as f64, 0);
        let overlaps: Vec<f64> = row.iter().flat_map(|s| s.overlaps.clone()).collect();
        let worst = overlaps.iter().copied().reduce(f64::min);
        let ratios: Vec<f64> = (0..MEASURES.len())
            .filter(|&place| MEASURES[place] != Measure::Stature)
            .flat_map(|place| ratios(row, place))
            .collect();
        let mut cells = vec![
            Cell::Text((*name).to_owned()),
            Cell::Number(row.len() as f64, 0),
            count(|s| s.error.is_some()),
            count(|s| s.refusal.is_some()),
            Cell::number(mean(&overlaps), 3),
            Cell::number(worst, 3),
        ];
        cells.extend([1.0, 2.0, 3.0].map(|limit| Cell::number(share(&ratios, limit), 0)));
        table.rows.push(cells);
    }
    table
}

/// Errors of the measures, in mm
fn errors_table(rows: &[(&str, Vec<&Scanned>)]) -> Table {
    let mut table =
        measure_table("errors against the naked body, mean and standard deviation, in mm");
    for (name, row) in rows {
        let mut cells = vec![Cell::Text((*name).to_owned())];
        cells.extend((0..MEASURES.len()).map(|place| {
            let errors = row.iter().filter_map(|s| Some(s.found[place]?.error_mm()));
            Cell::spread(&errors.collect::<Vec<f64>>())
        }));
        table.rows.push(cells);
    }
    table
}

/// Shares of the errors within one, two and three stated standard deviations, in percent
fn shares_table(rows: &[(&str, Vec<&Scanned>)]) -> Table {
    let mut table = measure_table("percentage of errors within 1, 2, 3 stated standard deviations");
    for (name, row) in rows {
        let mut cells = vec![Cell::Text((*name).to_owned())];
        cells.extend((0..MEASURES.len()).map(|place| {
            let ratios = ratios(row, place);
            let shares = [1.0, 2.0, 3.0].map(|limit| share(&ratios, limit));
            match shares {
                [Some(one), Some(two), Some(three)] => {
                    Cell::Text(format!("{one:.0}, {two:.0}, {three:.0}"))
                }
                _ => Cell::Missing,
            }
        }));
        table.rows.push(cells);
    }
    table
}

fn measure_table(title: &str) -> Table {
    let names = MEASURES.map(|measure| measure.name().replace('_', " "));
    let mut columns = vec!["outfit"];
    columns.extend(names.iter().map(String::as_str));
    Table::new(title, &columns)
}

/// Returns the absolute errors of a measure over their stated standard deviations
fn ratios(row: &[&Scanned], place: usize) -> Vec<f64> {
    let found = row.iter().filter_map(|s| s.found[place]);
    found.map(|f| f.error_mm().abs() / f.sd_mm).collect()
}

/// Returns the percentage of values up to a limit
fn share(values: &[f64], limit: f64) -> Option<f64> {
    let inside = values.iter().filter(|&&value| value <= limit).count() as f64;
    (!values.is_empty()).then(|| 100.0 * inside / values.len() as f64)
}

fn person_value(person: &Person, outfit: &str, scanned: &Scanned) -> Value {
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    let overlaps = scanned.overlaps.iter().map(|o| (o * 1e4).round() / 1e4);
    let mut value = json!({
        "seed": person.seed,
        "sex": person.sex.name(),
        "stature_mm": rounded(person.avatar.stature_mm()),
        "bmi": rounded(person.bmi),
        "outfit": outfit,
        "overlaps": overlaps.collect::<Vec<f64>>(),
        "error": scanned.error,
        "refusal": scanned.refusal,
    });
    for (measure, found) in MEASURES.iter().zip(&scanned.found) {
        value["measures"][measure.name()] = json!(found.map(|f| {
            json!({
                "true_mm": rounded(f.true_mm),
                "value_mm": rounded(f.value_mm),
                "sd_mm": rounded(f.sd_mm),
            })
        }));
    }
    value
}

fn page(options: &ClothesOptions, tables: &[Table]) -> String {
    let (width_px, height_px) = options.photo_size_px;
    let sections: Vec<String> = tables.iter().map(Table::to_section).collect();
    format!(
        "# Clothes, shoes and hair\n\n\
         `pirouette eval clothes` generates this page. {} random people are photographed in each outfit, in {} photos of\n\
         {width_px} x {height_px} px. They sway; keypoints are those of the body. The stature of the naked, barefoot body is stated, and\n\
         in some rows looseness, thickness of the soles, or sex and mass. Errors are those against the naked body. The first\n\
         outfits are as tight as skin; normal clothes add 80 mm to the girth of the trunk, loose ones 200 mm; soles are\n\
         {SOLE_MM:.0} mm thick. No cloth is simulated. A view without a silhouette has an overlap of 0.\n\n\
         `overlap` is the intersection over union of found and true silhouettes, over all photos; the shares of errors within\n\
         1, 2 and 3 stated standard deviations, in percent, leave out the stature, which is stated.\n\n{}",
        options.people,
        options.views,
        sections.join("\n"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_people_give_no_table() {
        let options = ClothesOptions {
            people: 0,
            ..ClothesOptions::default()
        };
        let found = study(&options, &CancelToken::default(), &mut |_| {});
        assert_eq!(found.unwrap_err(), StudyError::Nothing);
    }

    #[test]
    fn one_person_in_two_outfits_fills_tables_and_page() {
        let mut options = ClothesOptions {
            people: 1,
            views: 4,
            photo_size_px: (120, 150),
            ..ClothesOptions::default()
        };
        options
            .outfits
            .retain(|worn| worn.name == "shaved" || worn.name == "loose clothes, stated");
        let study = study(&options, &CancelToken::default(), &mut |_| {}).unwrap();
        for table in &study.tables {
            assert_eq!(table.rows.len(), 2);
        }
        let people = study.people.as_array().unwrap();
        let worst = |person: &Value| {
            let overlaps = person["overlaps"].as_array().unwrap().iter();
            overlaps.filter_map(Value::as_f64).fold(1.0, f64::min)
        };
        assert!(people.len() == 2 && worst(&people[0]) > 0.8, "{people:?}");
        assert!(
            study.page.contains("| loose clothes, stated |"),
            "{}",
            study.page
        );
    }
}
