//! A ray file and what its user says of it, as one argument: `blue.ray,length_unit=in,spectrum=blue.txt,flux=1.2W`.

use super::ray_file;
use super::ray_file::RayFiles;
use super::terminal::failure::Failure;
use pipeline::{
    Column, Declared, FluxOverride, Input, LengthUnit, MAX_SPECTRUM_BYTES, Notice, Quantity, SpectrumFile, Total,
};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Help of the argument.
pub const HELP: &str = "\
Ray files of one source, in one frame. What the file does not say, or says wrongly, follows it after commas:
  name=NAME        what the channel is called in the report
  length_unit=UNIT of its positions: mm um nm cm m in ft
  quantity=Q       what the flux values are: W (radiant) or lm (luminous)
  columns=A:B:..   what stands in each column of a text: x y z l m n flux radiant_flux luminous_flux
                   wavelength_nm wavelength_um tristimulus_x tristimulus_z ignored
  spectrum=FILE    spectrum of its light: two columns (nm or um, value), LightTools .sre, Zemax .spcd, Speos .spectrum, IES TM-27
  flux=FLUX        its flux, as 1.2W or 337lm
  share=SHARE      its share of --total, as 0.636W (of W) or 0.931lm (of lm)

A white LED in two files, split as its data sheet says:
  lampwright build yellow.ray,spectrum=yellow.txt,share=0.931lm blue.ray,spectrum=blue.txt,share=0.069lm --total 98lm -o out";

/// The keys, in the order of [`HELP`].
const KEYS: [&str; 7] = ["name", "length_unit", "quantity", "columns", "spectrum", "flux", "share"];

/// A ray file with declarations about it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelFile {
    path: PathBuf,
    spectrum: Option<PathBuf>,
    declared: Declared,
}

/// `input` with the declarations about it.
fn said(mut input: Input, declared: Declared, notices: Vec<Notice>) -> Input {
    input.declared = declared;
    input.notices.extend(notices);
    input
}

impl ChannelFile {
    /// Opens the file and reads its spectrum; what was repaired in that is a notice of the input.
    ///
    /// # Errors
    /// Whatever the disk answers; a spectrum that is refused.
    pub fn open(&self) -> Result<Input, Failure> {
        let (declared, notices) = self.declared()?;
        Ok(said(ray_file::open(&self.path)?, declared, notices))
    }

    /// The ray files that it is or holds.
    ///
    /// # Errors
    /// As [`ray_file::find`].
    pub fn find(&self) -> Result<RayFiles, Failure> {
        ray_file::find(&self.path)
    }

    /// Opens them all, each as [`ChannelFile::open`] would.
    ///
    /// # Errors
    /// A spectrum that is refused. Within: of one of the files, as [`ChannelFile::open`].
    pub fn open_all<'f>(
        &self,
        found: &'f RayFiles,
    ) -> Result<impl Iterator<Item = Result<Input, Failure>> + use<'f>, Failure> {
        let (declared, notices) = self.declared()?;
        Ok(found.open_all().map(move |input| Ok(said(input?, declared.clone(), notices.clone()))))
    }

    fn declared(&self) -> Result<(Declared, Vec<Notice>), Failure> {
        let Some(path) = &self.spectrum else { return Ok((self.declared.clone(), Vec::new())) };
        let read = spectrum(path)?;
        Ok((Declared { spectrum: Some(read.table), ..self.declared.clone() }, read.notices.to_vec()))
    }

    fn declare(&mut self, key: &str, value: &str) -> Result<(), String> {
        let declared = &mut self.declared;
        let flux = match key {
            "name" => return put(&mut declared.name, key, value.to_owned()),
            "length_unit" => return put(&mut declared.length_unit, key, unit(value)?),
            "quantity" => return put(&mut declared.quantity, key, quantity(value)?),
            "columns" => return put(&mut declared.columns, key, columns(value)?),
            "spectrum" => return put(&mut self.spectrum, key, PathBuf::from(value)),
            "flux" => match total(value)? {
                Total::RadiantW(watt) => FluxOverride::RadiantW(watt),
                Total::LuminousLm(lumen) => FluxOverride::LuminousLm(lumen),
            },
            _ => match total(value).map_err(|_| "write a share as 0.636W (of W) or 0.931lm (of lm)")? {
                Total::RadiantW(share) => FluxOverride::RadiantShare(share),
                Total::LuminousLm(share) => FluxOverride::LuminousShare(share),
            },
        };
        put(&mut declared.flux, "flux or share", flux)
    }
}

/// A spectrum file.
///
/// # Errors
/// Whatever the disk answers; a spectrum that is refused.
pub fn spectrum(path: &Path) -> Result<SpectrumFile, Failure> {
    pipeline::spectrum(&start(path)?).map_err(|error| Failure::from(error).at(path.display().to_string()))
}

/// The start of a file, one byte more than a spectrum may have.
fn start(path: &Path) -> Result<Vec<u8>, Failure> {
    let disk = |error: std::io::Error| Failure::disk(path, &error);
    let mut bytes = Vec::new();
    File::open(path).map_err(disk)?.take(MAX_SPECTRUM_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(disk)?;
    Ok(bytes)
}

/// What an argument names, and its keys with their values. A comma that no key follows belongs to what stands before it.
fn pieces(text: &str) -> Vec<(Option<&str>, String)> {
    let mut pieces: Vec<(Option<&str>, String)> = Vec::new();
    for piece in text.split(',') {
        let key = piece.split_once('=').filter(|(key, _)| key.chars().all(|c| c.is_ascii_lowercase() || c == '_'));
        match (key, pieces.last_mut()) {
            (_, None) => pieces.push((None, piece.to_owned())),
            (Some((key, value)), Some(_)) => pieces.push((Some(key), value.to_owned())),
            (None, Some((_, before))) => {
                before.push(',');
                before.push_str(piece);
            }
        }
    }
    pieces
}

/// `blue.ray,length_unit=in,flux=1.2W`.
pub fn channel(text: &str) -> Result<ChannelFile, String> {
    let mut channel = ChannelFile::default();
    let path = path_and_keys(text, &KEYS, |key, value| channel.declare(key, value))?;
    Ok(ChannelFile { path, ..channel })
}

/// The path that `text` begins with; `say` takes every key behind it, which is one of `keys`, and its value.
pub fn path_and_keys(
    text: &str,
    keys: &[&str],
    mut say: impl FnMut(&str, &str) -> Result<(), String>,
) -> Result<PathBuf, String> {
    let mut path = PathBuf::new();
    for (key, value) in pieces(text) {
        match key {
            None => path = PathBuf::from(value),
            Some(key) if !keys.contains(&key) => {
                return Err(format!("unknown key {key:?}; the keys are {}", keys.join(", ")));
            }
            Some(key) if value.is_empty() => return Err(format!("{key} is empty")),
            Some(key) => say(key, &value)?,
        }
    }
    Ok(path)
}

/// `1.2W` or `337lm`.
pub fn total(text: &str) -> Result<Total, String> {
    let number = |unit: &str| text.strip_suffix(unit).and_then(|number| number.trim().parse::<f64>().ok());
    let total = number("lm").map(Total::LuminousLm).or_else(|| number("W").map(Total::RadiantW));
    total.ok_or_else(|| "write a flux as 1.2W or 337lm".to_owned())
}

fn put<T>(place: &mut Option<T>, key: &str, value: T) -> Result<(), String> {
    match place.replace(value) {
        None => Ok(()),
        Some(_) => Err(format!("{key} is given twice")),
    }
}

fn unit(text: &str) -> Result<LengthUnit, String> {
    LengthUnit::from_symbol(text).ok_or_else(|| "write the unit as one of mm um nm cm m in ft".to_owned())
}

fn quantity(text: &str) -> Result<Quantity, String> {
    match text {
        "W" | "radiant" => Ok(Quantity::Radiant),
        "lm" | "luminous" => Ok(Quantity::Luminous),
        _ => Err("write the quantity as W or lm".to_owned()),
    }
}

fn columns(text: &str) -> Result<Vec<Column>, String> {
    let column = |name| Column::from_name(name).ok_or_else(|| format!("unknown column {name:?}"));
    text.split(':').map(column).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_that_can_be_said_arrives() {
        let said = "a,b.ray,name=blue, cold,length_unit=in,quantity=lm,columns=x:y:flux,spectrum=s,1.txt,share=0.25W";
        let expected = ChannelFile {
            path: "a,b.ray".into(),
            spectrum: Some("s,1.txt".into()),
            declared: Declared {
                name: Some("blue, cold".into()),
                length_unit: Some(LengthUnit::Inch),
                quantity: Some(Quantity::Luminous),
                columns: Some(vec![Column::X, Column::Y, Column::Flux]),
                spectrum: None,
                flux: Some(FluxOverride::RadiantShare(0.25)),
            },
        };
        assert_eq!(channel(said), Ok(expected));
        assert_eq!(channel("x=1.ray"), Ok(ChannelFile { path: "x=1.ray".into(), ..ChannelFile::default() }));
        for (said, flux) in [
            ("a,flux=1.5W", FluxOverride::RadiantW(1.5)),
            ("a,flux=337 lm", FluxOverride::LuminousLm(337.0)),
            ("a,share=0.069lm", FluxOverride::LuminousShare(0.069)),
        ] {
            assert_eq!(channel(said).unwrap().declared.flux, Some(flux), "{said}");
        }
    }

    #[test]
    fn nonsense_says_what_to_write() {
        for (said, complaint) in [
            ("a,units=mm", "unknown key \"units\""),
            ("a,length_unit=yd", "mm um nm cm m in ft"),
            ("a,quantity=cd", "W or lm"),
            ("a,flux=5", "1.2W or 337lm"),
            ("a,share=5%", "0.636W"),
            ("a,columns=x:u", "unknown column \"u\""),
            ("a,flux=1W,share=1W", "twice"),
            ("a,name=", "empty"),
        ] {
            let error = channel(said).unwrap_err();
            assert!(error.contains(complaint), "{said}: {error}");
        }
    }

    #[test]
    fn a_spectrum_is_read_with_its_ray_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        std::fs::write(path("a.ray"), "rays").unwrap();
        std::fs::write(path("a.txt"), "0.5 1\n0.6 1\n").unwrap();
        let said = format!("{},spectrum={}", path("a.ray"), path("a.txt"));
        let input = channel(&said).unwrap().open().unwrap();
        assert_eq!(input.notices[0].code, "spectrum.micrometres");
        assert_eq!(input.declared.spectrum.unwrap().range_nm(), (500.0, 600.0));
        std::fs::write(path("a.txt"), "0.5 x").unwrap();
        let failure = channel(&said).unwrap().open().err().unwrap();
        assert!(failure.to_string().contains("a.txt"), "{failure}");
    }
}
