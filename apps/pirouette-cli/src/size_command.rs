//! `pirouette size`: recommends garment sizes for a result folder.

use anyhow::{Context, Result, bail};
use pirouette::sizes::{Advice, Chart, ChartSex, advise};
use serde_json::{Value, json};

use crate::args::{Sex, SizeArgs};
use crate::output::Output;
use crate::scan_command::{charts, size_lines};

/// Reads the measurements and prints the recommended sizes
pub fn run(args: &SizeArgs, output: Output) -> Result<()> {
    let file = if args.out.is_dir() {
        args.out.join("measurements.json")
    } else {
        args.out.clone()
    };
    let charts = charts(args.chart.as_deref())?;
    let text = std::fs::read_to_string(&file).with_context(|| {
        format!(
            "cannot read {}; give a result folder of `pirouette scan`",
            file.display()
        )
    })?;
    let found: Value = serde_json::from_str(&text)
        .with_context(|| format!("{} is not valid JSON", file.display()))?;
    if !found["measurements_mm"].is_object() {
        bail!("{} contains no measurements", file.display());
    }
    if found["unit"] == "stature" {
        bail!(
            "{} is in units of the stature, but sizes require a scale; scan again with the stature or --scale card",
            file.display()
        );
    }
    let sex = match (args.sex, found["subject"]["sex"].as_str()) {
        (Some(Sex::Female), _) | (None, Some("female")) => Some(ChartSex::Female),
        (Some(Sex::Male), _) | (None, Some("male")) => Some(ChartSex::Male),
        (None, _) => None,
    };
    let dimension = |key: &str| {
        // Without a standard deviation, a value looks exact.
        let value_mm = found["measurements_mm"][key].as_f64()?;
        Some((value_mm, found["details"][key]["sd_mm"].as_f64()?))
    };
    let fits = |chart: &&Chart| sex.is_none() || chart.sex.is_none() || chart.sex == sex;
    let advice: Vec<Advice> = charts
        .iter()
        .filter(fits)
        .map(|chart| advise(chart, &dimension))
        .collect();
    if advice.is_empty() {
        bail!("the chart is for the other sex; pass --sex or another chart");
    }
    let estimates = below_clothes(&found, &advice);
    let mut text = size_lines(&advice);
    if !estimates.is_empty() {
        let listed: Vec<String> = estimates
            .iter()
            .map(|(key, sd_mm)| format!("{} ± {sd_mm:.0} mm", key.replace('_', " ")))
            .collect();
        text.push_str(&format!(
            "\nmeasured through clothes, as estimates of the body below: {}",
            listed.join(", ")
        ));
    }
    let keys: Vec<&String> = estimates.iter().map(|(key, _)| key).collect();
    output.done(
        &text,
        || json!({ "ok": true, "sizes": advice, "below_clothes": keys }),
    )
}

/// Returns the measures of the charts that are estimates below clothes, with their standard deviations
fn below_clothes(found: &Value, advice: &[Advice]) -> Vec<(String, f64)> {
    let mut estimates: Vec<(String, f64)> = Vec::new();
    for (key, _) in advice.iter().flat_map(|advice| &advice.by_measure) {
        let details = &found["details"][key];
        let is_new = estimates.iter().all(|(other, _)| other != key);
        if is_new && details["method"] == "below_clothes" {
            estimates.push((key.clone(), details["sd_mm"].as_f64().unwrap_or_default()));
        }
    }
    estimates
}
