//! Rays in columns of numbers (`pipeline/formats/README.md` 6): no standard says what they are. Names in a header line or the user's word are
//! obeyed; without them columns hold what they hold in every other format. What a file does not say is not guessed.

use super::column_names::{Named, named};
use super::lines::{Lines, Separator, leading_numbers};
use super::rows::{Grammar, LINE_OF_LIGHT, Rows, Slot, ray_columns, spectral};
use crate::error::{Error, Place};
use crate::formats::proof;
use crate::formats::record::{Bytes, Facts, Format, RaySet, TotalRule};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use std::sync::Arc;

/// Numbers a row starts with at least: position, direction, flux.
pub const FEWEST: usize = 7;
/// Rows looked at to see what a column holds.
const PROOF_ROWS: usize = 64;
/// What wavelengths in µm and in nm may be; no number is in both.
const LIGHT_UM: (f64, f64) = (0.1, 20.0);
const LIGHT_NM: (f64, f64) = (100.0, 20_000.0);
/// Where a user says what columns hold.
const DECLARED: Place = Place::Channel(0, "columns");
/// What to do where the file and we do not agree on its columns.
const DECLARE: &str = "Declare what each column holds: x, y, z, l, m, n, a flux, and \"ignored\" for the rest.";

/// Opens a file of this format, its columns as declared where they are.
///
/// # Errors
/// As [`crate::formats::open`]; [`Error::Unusable`] where the columns have to be declared, or are declared wrongly.
pub fn open(bytes: Arc<dyn Bytes>, columns: Option<&[Column]>, limits: &Limits) -> Result<RaySet, Error> {
    let head = Head::read(bytes.as_ref(), limits.max_text_bytes)?;
    let mut notices = Notices::default();
    let table = head.table(bytes.as_ref(), columns, &mut notices)?;
    let grammar = Grammar { separator: head.separator, slots: table.slots, end: None };
    let rows = Rows::index(bytes, head.rows_at, grammar, limits, &mut notices)?;
    let has = |column| table.columns.contains(&column);
    let has_luminous = has(Column::LuminousFlux);
    let facts = Facts {
        format: Format::Columns,
        ray_count: rows.count(),
        header_flux: Flux::default(),
        total_rule: TotalRule::RaySum,
        has_radiant: has(Column::RadiantFlux) || has(Column::Flux),
        has_luminous,
        spectral: spectral(&table.columns),
        length_unit: table.length_unit,
        quantity_unknown: has(Column::Flux),
        texts: head.texts,
        notices,
    };
    Ok(RaySet { facts, records: Box::new(rows) })
}

/// Nothing can be said against such a file by its start: its user may yet declare what its columns hold.
///
/// # Errors
/// `text.line_too_long`; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, _length: Option<u64>) -> Result<(), Error> {
    Lines::of(bytes).read_next().map(|_| ())
}

/// What stands before the rows, and how they are written.
struct Head {
    /// Lines before the rows.
    texts: Vec<(String, String)>,
    /// Of those the last that names columns.
    named: Option<Named>,
    separator: Separator,
    /// Columns of the first row.
    width: usize,
    /// Offset of the first row.
    rows_at: u64,
}

/// What the columns hold.
struct Table {
    columns: Vec<Column>,
    slots: Vec<Slot>,
    length_unit: Option<LengthUnit>,
}

impl Head {
    fn read(bytes: &dyn Bytes, max_bytes: usize) -> Result<Head, Error> {
        let mut lines = Lines::of(bytes);
        let (mut texts, mut last) = (Vec::new(), None);
        while let Some(line) = lines.read_next()? {
            if leading_numbers(line.text) >= FEWEST {
                let separator = Separator::of(line.text);
                let width = separator.fields(line.text).count();
                return Ok(Head { texts, named: last, separator, width, rows_at: line.at });
            }
            if line.at > max_bytes as u64 {
                break;
            }
            let text = line.to_text();
            last = named(text.trim_start_matches(['#', '!', '%', '/', ' '])).or(last);
            texts.push(("header".to_owned(), text));
        }
        let found = format!("No line has the {FEWEST} numbers of a ray: position, direction, flux.");
        Err(Error::malformed("columns.no_rows", found, "Send a file with one ray on a line.").at_byte(lines.at()))
    }
}

impl Head {
    fn table(&self, bytes: &dyn Bytes, declared: Option<&[Column]>, notices: &mut Notices) -> Result<Table, Error> {
        let proof = self.proof(bytes)?;
        let names = self.named.as_ref().filter(|_| declared.is_none());
        let mut slots = match (declared, names) {
            (Some(columns), _) => Slot::of(columns, 1.0).into_iter().map(Some).collect(),
            (None, Some(named)) => named.slots.clone(),
            (None, None) => self.by_position(notices)?,
        };
        if slots.len() != self.width {
            let by = if declared.is_some() { "declaration" } else { "header" };
            let found = format!("The {by} names {} columns; the rows have {}.", slots.len(), self.width);
            return Err(Error::invalid_declaration("columns.count", DECLARED, found, DECLARE));
        }
        for (k, slot) in slots.iter_mut().enumerate().filter(|(_, slot)| slot.is_none()) {
            *slot = Some(Slot::new(wavelength_unit(&proof, k, notices)?, 1.0));
        }
        let slots: Vec<Slot> = slots.into_iter().flatten().collect();
        let columns: Vec<Column> = slots.iter().map(|slot| slot.column).collect();
        judge(&columns)?;
        judge_directions(&columns, &proof)?;
        if let Some(names) = names.filter(|names| !names.unknown.is_empty()) {
            let told = format!("Columns with names we do not know were not read: {}.", names.unknown.join(", "));
            notices.add("columns.ignored", told);
        }
        let length_unit = names.map_or(Ok(None), Named::length_unit)?;
        Ok(Table { columns, slots, length_unit })
    }

    /// Seven columns are position, direction, flux; an eighth is the wavelength; nine end with tristimulus X, Y, Z in place of
    /// the flux, as LightTools has it. `None` is a wavelength of unknown unit.
    fn by_position(&self, notices: &mut Notices) -> Result<Vec<Option<Slot>>, Error> {
        let columns = match self.width {
            7 | 8 => ray_columns(&[Column::Flux]),
            9 => {
                let told = "Columns 7 to 9 were read as tristimulus X, Y, Z with Y in lm; the file does not name them.";
                notices.add("columns.tristimulus", told);
                ray_columns(&[Column::TristimulusX, Column::LuminousFlux, Column::TristimulusZ])
            }
            width => {
                let found = format!("The rows have {width} columns without names; only 7, 8 or 9 can be told apart.");
                return Err(Error::invalid_declaration("columns.unnamed", DECLARED, found, DECLARE));
            }
        };
        let slots = Slot::of(&columns, 1.0).into_iter().map(Some);
        Ok(slots.chain((self.width == 8).then_some(None)).collect())
    }

    /// The numbers of the first rows; NaN for what is none.
    fn proof(&self, bytes: &dyn Bytes) -> Result<Vec<Vec<f64>>, Error> {
        let mut lines = Lines::from(bytes, self.rows_at);
        let mut proof = Vec::new();
        while proof.len() < PROOF_ROWS
            && let Some(line) = lines.read_next()?
        {
            if !line.is_comment() {
                let fields = self.separator.fields(line.text);
                proof.push(fields.map(|(_, field)| self.separator.number(field).unwrap_or(f64::NAN)).collect());
            }
        }
        Ok(proof)
    }
}

/// nm or µm, where the values of column `k` leave no doubt.
fn wavelength_unit(proof: &[Vec<f64>], k: usize, notices: &mut Notices) -> Result<Column, Error> {
    let all_in = |(low, high): (f64, f64)| {
        proof.iter().filter_map(|row| row.get(k)).all(|value| *value >= low && *value <= high)
    };
    let (column, unit) = match () {
        () if all_in(LIGHT_UM) => (Column::WavelengthUm, "\u{b5}m"),
        () if all_in(LIGHT_NM) => (Column::WavelengthNm, "nm"),
        () => {
            let found = format!("Column {} does not read like wavelengths in nm or \u{b5}m.", k + 1);
            return Err(Error::invalid_declaration("columns.wavelength", DECLARED, found, DECLARE));
        }
    };
    let told = format!("Column {} was read as wavelengths in {unit}: its values say so, not the file.", k + 1);
    notices.add("columns.wavelength_unit", told);
    Ok(column)
}

/// All that a ray needs is there, and nothing twice.
///
/// # Errors
/// `columns.missing`, `columns.twice`.
pub fn judge(columns: &[Column]) -> Result<(), Error> {
    let count = |column: Column| columns.iter().filter(|other| **other == column).count();
    let fluxes = [Column::Flux, Column::RadiantFlux, Column::LuminousFlux].map(count);
    let missing: Vec<&str> = LINE_OF_LIGHT
        .into_iter()
        .filter(|column| count(*column) == 0)
        .map(Column::name)
        .chain((fluxes == [0; 3]).then_some("flux"))
        .collect();
    if !missing.is_empty() {
        let found = format!("No column holds {}.", missing.join(", "));
        return Err(Error::invalid_declaration("columns.missing", DECLARED, found, DECLARE));
    }
    let waves = count(Column::WavelengthNm) + count(Column::WavelengthUm);
    let unit_known = fluxes[1] + fluxes[2];
    let twice = Column::ALL.into_iter().find(|column| *column != Column::Ignored && count(*column) > 1);
    if twice.is_some() || waves > 1 || (fluxes[0] > 0 && unit_known > 0) {
        let what = twice.map_or(if waves > 1 { "a wavelength" } else { "a flux" }, Column::name);
        let found = format!("More than one column holds {what}.");
        return Err(Error::invalid_declaration("columns.twice", DECLARED, found, DECLARE));
    }
    Ok(())
}

/// What is called a direction is one; else columns stand in another order.
fn judge_directions(columns: &[Column], proof: &[Vec<f64>]) -> Result<(), Error> {
    let place = |column| columns.iter().position(|other| *other == column).unwrap_or(0);
    let at = [Column::L, Column::M, Column::N].map(place);
    let hold = |at: [usize; 3]| {
        let value = |row: &[f64], k: usize| row.get(k).copied().unwrap_or(f64::NAN);
        let held = proof.iter().filter(|row| proof::is_unit(at.map(|k| value(row, k)))).count();
        10 * held >= 9 * proof.len()
    };
    if hold(at) {
        return Ok(());
    }
    let [l, m, n] = at.map(|k| k + 1);
    let better = (2..columns.len()).map(|k| [k - 2, k - 1, k]).find(|at| hold(*at));
    let hint = better.map_or(String::new(), |[l, _, n]| format!(" Columns {} to {} are.", l + 1, n + 1));
    let found = format!("Columns {l}, {m} and {n} are no direction cosines: their squares do not sum to 1.{hint}");
    Err(Error::invalid_declaration("columns.directions", DECLARED, found, DECLARE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::record::{RawRay, SpectralData};

    fn with(text: &str, columns: Option<&[Column]>) -> Result<(Facts, RawRay), Error> {
        let set = open(Arc::new(text.as_bytes().to_vec()), columns, &Limits::default())?;
        let mut rays = Vec::new();
        set.records.read(0, set.facts.ray_count as usize, &mut rays)?;
        Ok((set.facts, rays[0]))
    }

    fn opened(text: &str) -> Result<(Facts, RawRay), Error> {
        with(text, None)
    }

    /// The ray of every file below: at (1, 2, −0.5), along +z, 0.25.
    const RAY: RawRay = RawRay {
        origin_mm: [1.0, 2.0, -0.5],
        direction: [0.0, 0.0, 1.0],
        radiant: 0.25,
        luminous: 0.0,
        wavelength_nm: 0.0,
        table: 0,
        xz: [0.0; 2],
    };

    #[test]
    fn bare_columns_say_neither_unit_nor_quantity() {
        for text in [
            "1 2 -0.5 0 0 1 0.25\n",
            "1\t2\t-0.5\t0\t0\t1\t0.25\n",
            "1, 2, -0.5, 0, 0, 1, 0.25\n",
            "1;2;-0,5;0;0;1;0,25;\n",
            "1\t2\t-0,5\t0\t0\t1\t0,25\n",
            "// made by hand\n% and\n! so\n\n1 2 -0.5 0 0 1 0.25\n",
            "\u{feff}1 2 -5.0D-01 0 0 1 0.25\n",
        ] {
            let (facts, ray) = opened(text).unwrap();
            assert_eq!(ray, RAY, "{text}");
            assert_eq!((facts.length_unit, facts.quantity_unknown), (None, true));
            assert_eq!((facts.has_radiant, facts.has_luminous, facts.total_rule), (true, false, TotalRule::RaySum));
            assert_eq!((facts.spectral, facts.notices), (SpectralData::None, Notices::default()));
        }
    }

    #[test]
    fn names_are_obeyed() {
        let told = |text: &str| {
            let (facts, ray) = opened(&format!("{text}\n")).unwrap();
            assert_eq!(facts.notices, Notices::default(), "{text}");
            (ray, facts.length_unit, facts.quantity_unknown)
        };
        let mm = Some(LengthUnit::Millimetre);
        assert_eq!(told("x,y,z,kx,ky,kz,flux\n1,2,-0.5,0,0,1,0.25"), (RAY, None, true));
        assert_eq!(told("Flux;L;M;N;X;Y;Z\n0,25;0;0;1;1;2;-0,5"), (RAY, None, true));
        assert_eq!(told("# x y z dx dy dz power_W\n1 2 -0.5 0 0 1 0.25"), (RAY, None, false));
        assert_eq!(told("x [mm] y [mm] z [mm] l m n watts\n1 2 -0.5 0 0 1 0.25"), (RAY, mm, false));
        assert_eq!(
            told("\"pos_x_mm\",\"pos_y_mm\",\"pos_z_mm\",dir_x,dir_y,dir_z,Power (mW)\n1,2,-0.5,0,0,1,250"),
            (RAY, mm, false)
        );
        let metre = Some(LengthUnit::Metre);
        assert_eq!(told("x_m\ty_m\tz_m\tl\tm\tn\tflux\n0.001\t0.002\t-0.0005\t0\t0\t1\t0.25"), (RAY, metre, true));
        let lumens = RawRay { radiant: 0.0, luminous: 0.25, ..RAY };
        assert_eq!(told("x,y,z,l,m,n,lumens\n1,2,-0.5,0,0,1,0.25"), (lumens, None, false));
        let colored = RawRay { wavelength_nm: 450.0, ..RAY };
        assert_eq!(told("x,y,z,l,m,n,W,wavelength [nm]\n1,2,-0.5,0,0,1,0.25,450"), (colored, None, false));
        assert_eq!(told("x,y,z,l,m,n,W,lambda_um\n1,2,-0.5,0,0,1,0.25,0.45"), (colored, None, false));
        let xyz = RawRay { xz: [7.0, 9.0], ..lumens };
        assert_eq!(told("x,y,z,kx,ky,kz,X,Y,Z\n1,2,-0.5,0,0,1,7,0.25,9"), (xyz, None, false));
        assert_eq!(
            told("x,y,z,kx,ky,kz,tristimulus_x,tristimulus_y,tristimulus_z\n1,2,-0.5,0,0,1,7,0.25,9"),
            (xyz, None, false)
        );
    }

    #[test]
    fn what_had_to_be_concluded_is_told() {
        for (value, nm) in [("450", 450.0), ("0.45", 450.0)] {
            for head in ["", "x y z l m n flux wavelength\n"] {
                let (facts, ray) = opened(&format!("{head}1 2 -0.5 0 0 1 0.25 {value}\n")).unwrap();
                assert_eq!((ray.wavelength_nm, facts.spectral), (nm, SpectralData::Wavelength));
                assert_eq!(facts.notices.count_of("columns.wavelength_unit"), 1);
            }
        }
        let (facts, ray) = opened("1 2 -0.5 0 0 1 7 8 9\n").unwrap();
        assert_eq!((ray.luminous, ray.xz, facts.quantity_unknown), (8.0, [7.0, 9.0], false));
        assert_eq!(facts.notices.count_of("columns.tristimulus"), 1);
        let (facts, ray) = opened("id,x,y,z,l,m,n,W,note\n7,1,2,-0.5,0,0,1,0.25,good\n").unwrap();
        assert_eq!((ray, facts.notices.count_of("columns.ignored")), (RAY, 1));
    }

    #[test]
    fn what_is_declared_comes_first() {
        use Column::{Ignored, L, LuminousFlux, M, N, WavelengthNm, X, Y, Z};
        let columns = [Ignored, L, M, N, X, Y, Z, WavelengthNm, LuminousFlux];
        let (facts, ray) = with("a,b,c\n1,0,0,1,1,2,-0.5,450,0.25\n", Some(&columns)).unwrap();
        assert_eq!(ray, RawRay { radiant: 0.0, luminous: 0.25, wavelength_nm: 450.0, ..RAY });
        assert!(facts.has_luminous && !facts.quantity_unknown);
    }

    #[test]
    fn what_has_to_be_declared_is_asked_for() {
        use Column::{Flux, L, LuminousFlux, M, N, WavelengthNm, WavelengthUm, X, Y, Z};
        let cases: [(&str, Option<&[Column]>, &str, &str); 12] = [
            ("0 0 1 1 2 3 5\n", None, "columns.directions", "Columns 1 to 3 are."),
            ("1 2 3 0 0 1 0.5 30\n", None, "columns.wavelength", "Column 8"),
            ("1 2 3 0 0 1 5 6 7 8\n", None, "columns.unnamed", "10 columns"),
            ("x,y,z,l,m,n,foo\n1,2,3,0,0,1,5\n", None, "columns.missing", "flux"),
            ("x,y,z,l,m,flux,foo\n1,2,3,0,0,1,5\n", None, "columns.missing", "n."),
            ("x,y,z,l,m,n,flux,power\n1,2,3,0,0,1,5,6\n", None, "columns.twice", "flux"),
            ("x,y,z,l,m,n\n1,2,3,0,0,1,5\n", None, "columns.count", "header names 6 columns"),
            ("x_mm,y_cm,z_mm,l,m,n,flux\n1,2,3,0,0,1,5\n", None, "columns.units", "different"),
            ("1 2 3 0 0 1 5\n", Some(&[X, Y, Z]), "columns.count", "declaration names 3"),
            ("1 2 3 0 0 1 5\n", Some(&[X, Y, Z, L, M, N, N]), "columns.missing", "flux"),
            ("1 2 3 0 0 1 5 6\n", Some(&[X, Y, Z, L, M, N, Flux, LuminousFlux]), "columns.twice", "a flux"),
            (
                "1 2 3 0 0 1 5 6 7\n",
                Some(&[X, Y, Z, L, M, N, Flux, WavelengthNm, WavelengthUm]),
                "columns.twice",
                "a wavelength",
            ),
        ];
        for (text, columns, code, word) in cases {
            let Err(Error::Unusable(fault)) = with(text, columns) else { panic!("read {text}") };
            assert_eq!(fault.code, code, "{text}");
            assert!(fault.found.contains(word), "{}", fault.found);
        }
        assert_eq!(opened("1 2 3 0 0 1\n").unwrap_err().code(), "columns.no_rows");
    }
}
