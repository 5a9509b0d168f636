//! Rays in columns of numbers (`pipeline/formats/README.md` 6): no standard says what they are. Names in a header line or the user's word are
//! obeyed; without them seven columns hold what they hold in every other format. What a file does not say is not guessed.

use super::column_names::{Named, flux_slot};
use super::column_rules::{DECLARE, DECLARE_WITHOUT_FLUX, DECLARED, has_flux, judge, tell_equal_shares, with_names};
use super::head::Head;
use super::lines::Lines;
use super::rows::{Grammar, Rows, Slot, ray_columns, spectral};
use crate::error::Error;
use crate::formats::proof;
use crate::formats::record::{Bytes, Facts, Format, RaySet, TotalRule};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit, Quantity};
use crate::vocabulary::wavelength::WavelengthUnit;
use glam::DVec3;
use std::sync::Arc;

/// Numbers a row starts with at least: position and direction.
pub const FEWEST: usize = super::head::WITHOUT_FLUX;
/// What to do where directions are none, whatever is declared.
const NO_DIRECTIONS: &str =
    "Export the file with direction cosines, which are vectors of length 1; no declaration mends it.";

/// Opens a file of this format, its columns as declared where they are.
///
/// # Errors
/// As [`crate::formats::open`]; [`Error::Unusable`] where the columns have to be declared, or are declared wrongly.
pub fn open(bytes: Arc<dyn Bytes>, columns: Option<&[Column]>, limits: &Limits) -> Result<RaySet, Error> {
    let head = Head::read(bytes.as_ref(), columns.map(<[Column]>::len), limits.max_text_bytes)?;
    let mut notices = Notices::default();
    let table = head.table(bytes.as_ref(), columns, &mut notices)?;
    let grammar = Grammar::new(head.separator, table.slots, None);
    let mut rows = Rows::index(bytes, head.rows_at, grammar, limits, &mut notices)?;
    head.tell_bare_lines(rows.count(), &mut notices);
    let has = |column| table.columns.contains(&column);
    let stored = match (has(Column::RadiantFlux), has(Column::LuminousFlux)) {
        (false, false) => None,
        (true, _) => Some(Quantity::Radiant),
        (false, true) => Some(Quantity::Luminous),
    };
    let (told, header_flux) = total(&mut rows, stored);
    let facts = Facts {
        format: Format::Columns,
        ray_count: rows.count(),
        header_flux,
        total_rule: TotalRule::RaySum,
        has_radiant: has(Column::RadiantFlux) || told != Some(Quantity::Luminous),
        has_luminous: has(Column::LuminousFlux) || told == Some(Quantity::Luminous),
        spectral: spectral(&table.columns),
        length_unit: table.length_unit,
        quantity_unknown: told.is_none(),
        texts: head.texts,
        notices,
    };
    Ok(RaySet { facts, records: Box::new(rows) })
}

/// What the flux is, and the total that a line behind the rows tells. Where neither names nor a declaration say what the flux is,
/// the unit of the total does.
fn total(rows: &mut Rows, stored: Option<Quantity>) -> (Option<Quantity>, Flux) {
    match (stored, rows.tail().total()) {
        (_, None) => (stored, Flux::default()),
        (stored, Some((value, None))) => (stored, Flux::only(stored.unwrap_or(Quantity::Radiant), Some(value))),
        (Some(stored), Some((value, Some((quantity, scale))))) => {
            (Some(stored), Flux::only(quantity, Some(value * scale).filter(|_| quantity == stored)))
        }
        (None, Some((value, Some((quantity, scale))))) => {
            rows.hold_flux(flux_slot(quantity, 1.0).column);
            (Some(quantity), Flux::only(quantity, Some(value * scale)))
        }
    }
}

/// Nothing can be said against such a file by its start: its user may yet declare what its columns hold.
///
/// # Errors
/// `text.line_too_long`; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, _length: Option<u64>) -> Result<(), Error> {
    Lines::of(bytes).read_next().map(|_| ())
}

/// What the columns hold.
struct Table {
    columns: Vec<Column>,
    slots: Vec<Slot>,
    length_unit: Option<LengthUnit>,
}

impl Head {
    fn table(&self, bytes: &dyn Bytes, declared: Option<&[Column]>, notices: &mut Notices) -> Result<Table, Error> {
        let proof = self.proof(bytes)?;
        let told = self.told;
        let names = self.named.clone().filter(|_| declared.is_none());
        let names = names.map(|named| told.length.map_or(named.clone(), |unit| named.in_unit(unit)));
        let mm = told.length.map_or(1.0, LengthUnit::mm);
        let mut slots = match (declared, &names) {
            (Some(columns), _) => self.as_declared(columns, mm, notices),
            (None, Some(named)) => named.slots.clone(),
            (None, None) => self.by_position(&proof, mm)?,
        };
        if slots.len() != self.width {
            let by = if declared.is_some() { "declaration" } else { "header" };
            let found = format!("The {by} names {} columns; the rows have {}.", slots.len(), self.width);
            return Err(Error::invalid_declaration("columns.count", DECLARED, found, DECLARE));
        }
        for (k, slot) in slots.iter_mut().enumerate().filter(|(_, slot)| slot.is_none()) {
            *slot = Some(Slot::new(wavelength_unit(&proof, k, notices)?, 1.0));
        }
        let mut slots: Vec<Slot> = slots.into_iter().flatten().collect();
        if let Some((quantity, scale)) = told.flux {
            slots
                .iter_mut()
                .filter(|slot| slot.column == Column::Flux)
                .for_each(|slot| *slot = flux_slot(quantity, scale));
        }
        let columns: Vec<Column> = slots.iter().map(|slot| slot.column).collect();
        let unknown = names.as_ref().map_or(String::new(), |names| names.unknown.join(", "));
        judge(&columns, declared.is_some()).map_err(|error| with_names(error, &unknown))?;
        judge_directions(&columns, &proof)?;
        tell_equal_shares(&columns, notices);
        if !unknown.is_empty() {
            notices.add("columns.ignored", format!("Columns with names we do not know were not read: {unknown}."));
        }
        let length_unit = names.as_ref().map_or(Ok(None), Named::length_unit)?.or(told.length);
        Ok(Table { columns, slots, length_unit })
    }

    /// The columns that were declared. Where the file's own name of a flux has a unit, that holds for a column that is declared
    /// as flux and no more; where it may differ from the declared one, that is told.
    fn as_declared(&self, columns: &[Column], mm: f64, notices: &mut Notices) -> Vec<Option<Slot>> {
        let mut slots = Slot::of(columns, mm);
        let names = self.named.iter().flat_map(|named| named.slots.iter().zip(&named.names));
        for (slot, (named, name)) in slots.iter_mut().zip(names).filter(|(slot, _)| has_flux(&[slot.column])) {
            match named {
                Some(named)
                    if slot.column == Column::Flux && named.column != Column::Flux && has_flux(&[named.column]) =>
                {
                    *slot = *named;
                    let told =
                        format!("The column declared as flux is called \"{name}\" in the file; that unit was kept.");
                    notices.add("columns.flux_unit", told);
                }
                Some(named) if named != slot && name.contains(['[', '(']) => {
                    let told = format!(
                        "The column declared as flux is called \"{name}\" in the file; its values were read as declared, in W or \
                         lm. If they are in another unit, declare the flux of the whole too."
                    );
                    notices.add("columns.flux_unit", told);
                }
                _ => {}
            }
        }
        slots.into_iter().map(Some).collect()
    }

    /// Seven columns are position, direction, flux. More have no meaning until a name or a declaration gives them one: FRED has the
    /// path length where others have the wavelength.
    fn by_position(&self, proof: &[Vec<f64>], mm: f64) -> Result<Vec<Option<Slot>>, Error> {
        if self.width == 7 {
            return Ok(Slot::of(&ray_columns(&[Column::Flux]), mm).into_iter().map(Some).collect());
        }
        if self.width < 7 {
            let found = "The rows have 6 columns without names: position and direction by their order, and no flux.";
            return Err(Error::invalid_declaration("columns.missing", DECLARED, found, DECLARE_WITHOUT_FLUX));
        }
        let seen: Vec<String> = (6..self.width.min(12)).map(|k| values(proof, k)).collect();
        let found = format!(
            "The rows have {} columns without names, which says nothing of those after position and direction. In the first {} \
             rows, {}.",
            self.width,
            proof.len(),
            seen.join(", ")
        );
        let remedy = format!(
            "{DECLARE} A wavelength is wavelength_nm or wavelength_um, X, Y and Z are tristimulus_x, luminous_flux and \
             tristimulus_z; what is none of these (a path length, a number) is \"ignored\"."
        );
        Err(Error::invalid_declaration("columns.unnamed", DECLARED, found, remedy))
    }
}

/// What column `k` holds, and what that could be.
fn values(proof: &[Vec<f64>], k: usize) -> String {
    let values = || proof.iter().filter_map(|row| row.get(k)).copied().filter(|value| value.is_finite());
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let share = |unit: WavelengthUnit| {
        let visible = values().filter(|value| (380.0..=780.0).contains(&(value * unit.nm()))).count();
        100.0 * visible as f64 / values().count().max(1) as f64
    };
    let (nm, um) = (share(WavelengthUnit::Nanometre), share(WavelengthUnit::Micrometre));
    let light = match (nm > 0.0, um > 0.0) {
        (true, _) => format!(" ({nm:.0} % visible light if in nm)"),
        (_, true) => format!(" ({um:.0} % visible light if in \u{b5}m)"),
        _ => String::new(),
    };
    format!("column {} is {low} to {high}{light}", k + 1)
}

/// nm or µm, where the values of column `k` leave no doubt.
fn wavelength_unit(proof: &[Vec<f64>], k: usize, notices: &mut Notices) -> Result<Column, Error> {
    let values = proof.iter().filter_map(|row| row.get(k)).copied().filter(|value| !value.is_nan());
    let (column, unit) = match WavelengthUnit::of(values) {
        Ok(WavelengthUnit::Micrometre) => (Column::WavelengthUm, "\u{b5}m"),
        Ok(WavelengthUnit::Nanometre) => (Column::WavelengthNm, "nm"),
        Err(stray) => {
            let found = format!("Column {} does not read like wavelengths in nm or \u{b5}m; see {stray}.", k + 1);
            return Err(Error::invalid_declaration("columns.wavelength", DECLARED, found, DECLARE));
        }
    };
    let told = format!("Column {} was read as wavelengths in {unit}: its values say so, not the file.", k + 1);
    notices.add("columns.wavelength_unit", told);
    Ok(column)
}

/// What is called a direction is one; else columns stand in another order.
///
/// # Errors
/// `columns.directions`.
fn judge_directions(columns: &[Column], proof: &[Vec<f64>]) -> Result<(), Error> {
    let place = |column| columns.iter().position(|other| *other == column).unwrap_or(0);
    let at = [Column::L, Column::M, Column::N].map(place);
    let vector = |row: &[f64], at: [usize; 3]| at.map(|k| row.get(k).copied().unwrap_or(f64::NAN));
    let hold = |at: [usize; 3]| {
        let held = proof.iter().filter(|row| proof::is_unit(vector(row, at))).count();
        10 * held >= 9 * proof.len()
    };
    if hold(at) {
        return Ok(());
    }
    let lengths =
        proof.iter().map(|row| DVec3::from_array(vector(row, at)).length()).filter(|length| length.is_finite());
    let (low, high) = lengths.fold((f64::INFINITY, 0.0_f64), |(low, high), length| (low.min(length), high.max(length)));
    let [l, m, n] = at.map(|k| k + 1);
    let better = (2..columns.len()).map(|k| [k - 2, k - 1, k]).find(|at| hold(*at));
    let hint = better.map_or(String::new(), |[l, _, n]| format!(" Columns {} to {} are.", l + 1, n + 1));
    let found = format!(
        "Columns {l}, {m} and {n} are no direction cosines: as vectors their lengths are {low:.4} to {high:.4}, not 1.{hint}"
    );
    let remedy = if better.is_some() { DECLARE } else { NO_DIRECTIONS };
    Err(Error::invalid_declaration("columns.directions", DECLARED, found, remedy))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::record::{EQUAL_SHARES, RawRay, SpectralData};

    fn with(text: &str, columns: Option<&[Column]>) -> Result<(Facts, RawRay), Error> {
        open(Arc::new(text.as_bytes().to_vec()), columns, &Limits::default())?
            .read_all()
            .map(|(facts, rays)| (facts, rays[0]))
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
            let text = format!("x y z l m n flux wavelength\n1 2 -0.5 0 0 1 0.25 {value}\n");
            let (facts, ray) = opened(&text).unwrap();
            assert_eq!((ray.wavelength_nm, facts.spectral), (nm, SpectralData::Wavelength));
            assert_eq!(facts.notices.count_of("columns.wavelength_unit"), 1);
        }
        let (facts, ray) = opened("id,x,y,z,l,m,n,W,note\n7,1,2,-0.5,0,0,1,0.25,good\n").unwrap();
        assert_eq!((ray, facts.notices.count_of("columns.ignored")), (RAY, 1));
    }

    #[test]
    fn units_are_understood_where_they_are_written() {
        let told = |head: &str, row: &str| {
            let (facts, ray) = opened(&format!("{head}\n{row}\n")).unwrap();
            (ray, facts.length_unit, facts.quantity_unknown)
        };
        let mm = Some(LengthUnit::Millimetre);
        let lumens = RawRay { radiant: 0.0, luminous: 0.25, ..RAY };
        let row = "1 2 -0.5 0 0 1 0.25";
        let csv = "1,2,-0.5,0,0,1,0.25";
        assert_eq!(told("x,y,z,l,m,n,flux\nmm,mm,mm,,,,lm", csv), (lumens, mm, false));
        assert_eq!(told("x y z l m n flux\n[mm] [mm] [mm] - - - [W]", row), (RAY, mm, false));
        assert_eq!(told("Units: mm\nFlux unit: lumen\nx y z l m n flux", row), (lumens, mm, false));
        assert_eq!(told("# Length unit: mm", row), (RAY, mm, true));
        assert_eq!(told("X Pos  Y Pos  Z Pos  X Vec  Y Vec  Z Vec  Inc Flux", row), (RAY, None, true));
        assert_eq!(told("X Pos Y Pos Z Pos X Vec Y Vec Z Vec Inc Flux", row), (RAY, None, true));
        assert_eq!(
            told("x(cm) y(cm) z(cm) l m n P(W)", "0.1 0.2 -0.05 0 0 1 0.25"),
            (RAY, Some(LengthUnit::Centimetre), false)
        );
        let scaled =
            |name: &str, value: f64| told(&format!("x,y,z,l,m,n,{name}"), &format!("1,2,-0.5,0,0,1,{value}")).0;
        for (name, value) in [("power [uW]", 250_000.0), ("P (mW)", 250.0), ("kW", 0.00025)] {
            assert!((scaled(name, value).radiant - 0.25).abs() < 1e-12, "{name}");
        }
        assert!((scaled("flux [klm]", 0.00025).luminous - 0.25).abs() < 1e-12);
        // Mega by the SI, milli where people write in capitals: asked for.
        let error = opened("x,y,z,l,m,n,power [MW]\n1,2,3,0,0,1,5\n").unwrap_err();
        assert!(error.code() == "columns.missing" && error.to_string().contains("power [MW]"), "{error}");
    }

    /// What is declared as flux and no more keeps the unit of its name, and what is declared in W is told where the name differs.
    #[test]
    fn a_prefix_is_not_lost_by_a_declaration() {
        let columns = |flux| ray_columns(&[flux]);
        let text = "x,y,z,l,m,n,power [mW]\n1,2,-0.5,0,0,1,250\n";
        let (facts, ray) = with(text, Some(&columns(Column::Flux))).unwrap();
        assert_eq!((ray.radiant, facts.notices.count_of("columns.flux_unit")), (0.25, 1));
        let (facts, ray) = with(text, Some(&columns(Column::RadiantFlux))).unwrap();
        assert_eq!((ray.radiant, facts.notices.count_of("columns.flux_unit")), (250.0, 1));
        let unknown = "x,y,z,l,m,n,power [MW]\n1,2,-0.5,0,0,1,250\n";
        let (facts, _) = with(unknown, Some(&columns(Column::Flux))).unwrap();
        assert_eq!(facts.notices.count_of("columns.flux_unit"), 1);
    }

    #[test]
    fn rays_without_flux_count_alike_where_that_is_declared() {
        let columns = ray_columns(&[Column::WavelengthNm]);
        let (facts, ray) = with("1 2 -0.5 0 0 1 450\n", Some(&columns)).unwrap();
        assert_eq!((ray.radiant, ray.wavelength_nm), (1.0, 450.0));
        assert!(facts.quantity_unknown && facts.notices.count_of(EQUAL_SHARES) == 1);
    }

    /// A total behind the rows is compared; where nothing else does, its unit says what the flux is.
    #[test]
    fn lines_behind_the_rows_are_no_rows() {
        let row = "1 2 -0.5 0 0 1 0.25\n";
        for (tail, header, unknown, notices) in [
            ("END\n", Flux::default(), true, 1),
            ("Total flux: 0.5 W\n", Flux::only(Quantity::Radiant, Some(0.5)), false, 1),
            ("Sum 0.5\n\x1a", Flux::only(Quantity::Radiant, Some(0.5)), true, 2),
            ("Total: 500 mlm", Flux::only(Quantity::Luminous, Some(0.5)), false, 1),
            ("\0\0\0", Flux::default(), true, 1),
        ] {
            let (facts, ray) = opened(&[row, row, tail].concat()).unwrap();
            assert_eq!((facts.ray_count, facts.header_flux, facts.quantity_unknown), (2, header, unknown), "{tail}");
            assert_eq!(facts.notices.iter().count(), notices, "{tail}");
            assert_eq!(ray.radiant + ray.luminous, 0.25, "{tail}");
        }
        assert_eq!(opened(&[row, "END\n", row].concat()).unwrap_err().code(), "text.not_a_number");
        let error = with(&[row, "\0\0", row].concat(), None).unwrap_err();
        assert_eq!(error.code(), "text.control");
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
        let cases: [(&str, Option<&[Column]>, &str, &str); 17] = [
            ("0 0 1 1 2 3 5\n", None, "columns.directions", "Columns 1 to 3 are."),
            // FRED has the path length in the eighth column; it may look like a wavelength.
            ("1 2 3 0 0 1 0.5 30\n", None, "columns.unnamed", "column 8 is 30 to 30"),
            ("1 2 3 0 0 1 0.5 0.55\n", None, "columns.unnamed", "100 % visible light if in \u{b5}m"),
            ("1 2 3 0 0 1 7 8 9\n", None, "columns.unnamed", "column 9 is 9 to 9"),
            ("1 2 3 0 0 1\n", None, "columns.missing", "no flux"),
            ("x y z l m n flux wavelength\n1 2 3 0 0 1 0.5 30\n", None, "columns.wavelength", "Column 8"),
            ("1 2 3 0 0 2.5 0.5\n", None, "columns.directions", "lengths are 2.5000 to 2.5000"),
            ("1 2 3 0 0 1 5 6 7 8\n", None, "columns.unnamed", "10 columns"),
            ("x,y,z,l,m,n,foo\n1,2,3,0,0,1,5\n", None, "columns.missing", "flux"),
            ("x,y,z,l,m,flux,foo\n1,2,3,0,0,1,5\n", None, "columns.missing", "n."),
            ("x,y,z,l,m,n,flux,power\n1,2,3,0,0,1,5,6\n", None, "columns.twice", "flux"),
            ("x,y,z,l,m,n\n1,2,3,0,0,1,5\n", None, "columns.count", "header names 6 columns"),
            ("x_mm,y_cm,z_mm,l,m,n,flux\n1,2,3,0,0,1,5\n", None, "columns.units", "different"),
            ("1 2 3 0 0 1 5\n", Some(&[X, Y, Z]), "columns.count", "declaration names 3"),
            ("1 2 3 0 0 1 5\n", Some(&[X, Y, Z, L, M, N, N]), "columns.twice", "holds n"),
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
        assert_eq!(opened("1 2 3 0 0\n").unwrap_err().code(), "columns.no_rows");
    }
}
