//! Writes the scan folder of a rendered person, with photos of any size and number.
//!
//! `render-scan FOLDER WIDTH HEIGHT VIEWS`

use std::error::Error;
use std::path::Path;

use pirouette_bench::photograph;
use pirouette_files::scan_folder::write_scan;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, width, height, views] = arguments.as_slice() else {
        return Err("usage: render-scan FOLDER WIDTH HEIGHT VIEWS".into());
    };
    let synthetic = photograph(width.parse()?, height.parse()?, views.parse()?);
    write_scan(Path::new(folder), &synthetic.scan)?;
    Ok(())
}
