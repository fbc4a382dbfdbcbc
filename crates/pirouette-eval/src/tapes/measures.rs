//! The page of all measures: definitions, names elsewhere, accuracy, and a picture of all tapes.

use pirouette::measure::{Basis, MeasureInput, measure};
use pirouette_body::Sex;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::render::SilhouetteMesh;
use pirouette_files::formats::export::ExportFormat;
use pirouette_files::formats::photo::encode_jpeg;
use pirouette_files::report::tape_sheet;

use super::*;

/// Quality of the picture
const JPEG_QUALITY: u8 = 85;

/// Returns the page; `condition` selects the scans of its accuracies
pub(super) fn measures_page(scanned: &[Scanned], condition: Condition) -> String {
    let mut page = format!(
        "# Measures\n\n\
         `pirouette eval tapes -o docs` writes this page: all {} measures, their names in other programs, and their errors on\n\
         rendered people in eight photos ([accuracy.md](accuracy.md)).\n\n\
         Definitions follow ISO 8559-1:2017 as far as a surface shows them without palpation: bones are joints of the fitted\n\
         skeleton, and the waist is where the survey ANSUR II has it on bodies with the same crotch height. A level tape is\n\
         horizontal. All girths are the perimeters of convex sections, like a taut tape, which bridges folds and hollows. They\n\
         are measured without contact: a tape of cloth compresses soft tissue and is shorter there (column *soft*).\n\n\
         The other programs' names are given where they mean the same place. FreeSewing's `hips` are at the waist of trousers,\n\
         and Seamly2D's `waist_natural_circ` is placed by hand: they have no counterpart.\n\n\
         ![Mannequin with all tapes](measures.jpg)\n\n\
         | measure | German | definition | found by | soft | FreeSewing | Seamly2D | schema.org | bias ± SD, mm | MAE, mm |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
        Measure::ALL.len(),
    );
    for measure in Measure::ALL {
        let errors = errors(scanned, condition, measure);
        let absolute: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        let spread = Spread::of(&errors).map(|s| format!("{:+.1} ± {:.1}", s.mean, s.sd));
        let name = |format: ExportFormat| {
            let name = format.name_of(measure);
            name.map_or(String::new(), |name| {
                format!("`{}`", name.trim_start_matches("BodyMeasurement"))
            })
        };
        let _ = writeln!(
            page,
            "| `{}` | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            measure.name(),
            measure.german_name(),
            measure.definition(),
            match measure.basis() {
                Basis::Skin => "skin",
                Basis::Joints => "joints",
                Basis::SkinAndSurvey => "skin and survey",
            },
            if measure.is_on_soft_tissue() {
                "yes"
            } else {
                ""
            },
            name(ExportFormat::FreeSewing),
            name(ExportFormat::Seamly2d),
            name(ExportFormat::SchemaOrg),
            spread.unwrap_or_default(),
            mean(&absolute).map_or(String::new(), |mean| format!("{mean:.1}")),
        );
    }
    page
}

/// Draws a mannequin with all tapes; empty if it cannot be encoded
pub(super) fn measures_picture() -> Vec<u8> {
    let parameters = MannequinParameters {
        sex: Sex::Female,
        ..MannequinParameters::default()
    };
    let Ok(avatar) = mannequin(&parameters) else {
        return Vec::new();
    };
    let measurements = measure(&MeasureInput::of_avatar(&avatar));
    let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
    let sheet = tape_sheet(&avatar.mesh, &mesh, &measurements);
    encode_jpeg(&sheet, JPEG_QUALITY).unwrap_or_default()
}
