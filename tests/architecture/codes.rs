//! The page of all stable codes (`openapi/CODES.md`) is what the source says: found by where they stand, compared, written on demand.

/// The page as Markdown.
mod page;
/// Strings of the source, and what stands around them.
mod source;
/// What an expression, a pattern or an attribute says by itself.
mod syntax;

use super::reading::House;
use page::{Kind, Row, page};
use source::{Arg, Arm, Call, Place, Seen, Source};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Set, the page is written instead of compared.
const WRITE: &str = "LAMPWRIGHT_WRITE_CODES";
/// Fewest codes there can be; fewer means that this test looked in the wrong place.
const FEWEST_CODES: usize = 250;

/// Calls that a code is given to, which of their arguments it is, and which has the words. A struct that is made counts as a call of
/// its code and its title.
const CALLS: [(&str, usize, usize, Kind); 12] = [
    ("Problem::new", 1, 2, Kind::Problem(None)),
    ("Failure{}", 0, 1, Kind::Job),
    ("Error::malformed", 0, 1, Kind::Malformed),
    ("Error::refused", 0, 1, Kind::Refused),
    ("Error::unusable", 0, 2, Kind::Unusable),
    ("Error::invalid_declaration", 0, 2, Kind::Unusable),
    (".add", 0, 1, Kind::Notice),
    (".add_ray", 0, 2, Kind::Notice),
    (".count", 0, 3, Kind::Notice),
    ("Check{}", 0, 1, Kind::Check),
    ("Failure::failed", 0, 1, Kind::Failed),
    ("Failure::usage", 0, 1, Kind::Usage),
];

/// The call that a check says that nothing is the matter with.
const CALM: &str = "ok";

/// Types with a function `code`, and what their codes are.
const CODED: [(&str, Kind); 3] = [("Flaw", Kind::Notice), ("Error", Kind::Job), ("Unusable", Kind::Failed)];

/// What looks like a code and is none: the whole string, its beginning or its end (`*` is the rest), and what it is.
const NOT_CODES: [(&str, &str); 33] = [
    ("*.glb", "a file"),
    ("*.json", "a file"),
    ("*.csv", "a file"),
    ("*.svg", "a file"),
    ("*.zip", "a file"),
    ("*.npz", "a file"),
    ("*.xml", "a file"),
    ("*.gldf", "a file"),
    ("*.obj", "a file"),
    ("*.ply", "a file"),
    ("*.py", "a file"),
    ("*.rad", "a file"),
    ("*.cal", "a file"),
    ("*.dat", "a file"),
    ("service.db", "a file"),
    ("service.db.new", "a file"),
    ("memory.max", "a file of the kernel's"),
    ("rays.band_edges_nm", "an option: the place of a fault"),
    ("hull.emission", "an option"),
    ("hull.resolution", "an option"),
    ("hull.max_edge_mm", "an option"),
    ("goniogram.*", "an option"),
    ("view.*", "a field of an evaluation: the place of a fault"),
    ("job.succeeded", "an event that a webhook is told"),
    ("job.failed", "an event"),
    ("job.cancelled", "an event"),
    ("service.version", "an attribute of traces"),
    ("*.committed", "a point of service/crash.rs"),
    ("*.before_commit", "a point of service/crash.rs"),
    ("stage.*", "a point of service/crash.rs"),
    ("upload.part_stored", "a point of service/crash.rs"),
    ("publish.blob_stored", "a point of service/crash.rs"),
    ("deliver.answered", "a point of service/crash.rs"),
];

/// A word that begins with a letter, a dot, and words with dots between.
fn is_code(text: &str) -> bool {
    let letter = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    text.starts_with(|c: char| c.is_ascii_lowercase())
        && text.contains('.')
        && text.split('.').all(|word| !word.is_empty() && word.chars().all(letter))
}

/// The row of [`NOT_CODES`] that a string falls under.
fn excuse(text: &str) -> Option<&'static str> {
    let falls = |what: &str| match (what.strip_prefix('*'), what.strip_suffix('*')) {
        (Some(end), _) => text.ends_with(end),
        (_, Some(start)) => text.starts_with(start),
        _ => text == what,
    };
    // Files are told by codes that end as their names do.
    let is_told = text.starts_with("detect.");
    NOT_CODES.iter().map(|(what, _)| *what).find(|what| !is_told && falls(what))
}

/// A call that a code is given to: what it is, and the arguments that matter.
struct Told {
    kind: Kind,
    code: Arg,
    words: Arg,
    /// What follows the words: mostly what to do.
    next: Option<String>,
    status: Arg,
}

/// The codes of a source, and what could not be read.
struct Reader<'s> {
    source: &'s Source,
    /// Scopes by name, calls by scope and by what is called.
    named: BTreeMap<&'s str, Vec<usize>>,
    inside: BTreeMap<usize, Vec<&'s Call>>,
    calls: BTreeMap<&'s str, Vec<&'s Call>>,
    /// Calls that are given a code under a name, by scope.
    variable: BTreeMap<usize, Vec<Told>>,
    rows: Vec<Row>,
    offences: BTreeSet<String>,
}

impl<'s> Reader<'s> {
    fn read(source: &'s Source) -> Reader<'s> {
        let (mut named, mut inside, mut calls): (BTreeMap<_, Vec<_>>, BTreeMap<_, Vec<_>>, BTreeMap<_, Vec<_>>) =
            Default::default();
        let names = source.scopes.iter().enumerate().filter(|(_, scope)| !scope.name.is_empty());
        names.for_each(|(index, scope)| named.entry(scope.name.as_str()).or_default().push(index));
        source.calls.iter().for_each(|call| inside.entry(call.scope).or_default().push(call));
        source.calls.iter().for_each(|call| calls.entry(call.callee.as_str()).or_default().push(call));
        let mut reader = Reader {
            source,
            named,
            inside,
            calls,
            variable: BTreeMap::new(),
            rows: Vec::new(),
            offences: BTreeSet::new(),
        };
        source.calls.iter().for_each(|call| reader.call(call));
        source.seen.iter().for_each(|seen| reader.seen(seen));
        let known: BTreeSet<String> = reader.rows.iter().map(|row| row.code.clone()).collect();
        for seen in source.seen.iter().filter(|seen| is_code(&seen.text) && excuse(&seen.text).is_none()) {
            if !known.contains(&seen.text) {
                reader
                    .offends(seen.scope, &format!("{:?} is no code that was understood, nor in NOT_CODES", seen.text));
            }
        }
        reader
    }

    fn offends(&mut self, scope: usize, complaint: &str) {
        let place = &self.source.scopes[scope];
        self.offences.insert(format!("src/{} {}: {complaint}", place.file, place.name));
    }

    /// What a call says, if it is one of [`CALLS`] or of a function that hands its arguments on to one.
    fn told(&self, call: &Call, depth: usize) -> Option<Told> {
        let arg = |at: usize| call.args.get(at).cloned().unwrap_or_default();
        if let Some((_, code, words, kind)) = CALLS.iter().find(|(callee, ..)| *callee == call.callee) {
            let code = arg(*code);
            let is_const = code.ident.as_ref().is_some_and(|name| is_constant(name));
            let fits = *kind != Kind::Notice
                || call.args.len() == words + 1
                    && (call.on == "notices" || is_const || code.literal.as_deref().is_some_and(is_code));
            // On the command line a failure is made of an error's own code.
            let ours = call.callee != "Failure{}" || !self.source.scopes[call.scope].file.starts_with("command");
            let next = call.args.get(words + 1).and_then(|next| self.words(call.scope, next));
            return (fits && ours).then(|| Told { kind: *kind, code, words: arg(*words), next, status: arg(0) });
        }
        let (of, name) = call.callee.split_once("::").unwrap_or(("", &call.callee));
        let here = &self.source.scopes[call.scope].file;
        let scopes = &self.source.scopes;
        let is_meant = |index: &&usize| scopes[**index].of == of && (!of.is_empty() || scopes[**index].file == *here);
        let helper = *self.named.get(name)?.iter().filter(is_meant).min_by_key(|index| index.abs_diff(call.scope))?;
        let scope = &scopes[helper];
        let inside = self.inside.get(&helper).into_iter().flatten().filter(|_| depth > 0);
        let place = |arg: &Arg| arg.ident.as_ref().and_then(|name| scope.params.iter().position(|param| param == name));
        inside.filter_map(|inner| self.told(inner, depth - 1)).find_map(|told| {
            let code = arg(place(&told.code)?);
            let status =
                if told.status.status.is_none() { place(&told.status).map_or(told.status, arg) } else { told.status };
            let words = match (&told.words.words, place(&told.words)) {
                (None, Some(at)) => arg(at),
                (Some(template), _) => {
                    let put = |text: String, (at, param): (usize, &String)| match arg(at).literal {
                        Some(given) => text.replace(&["{", param, "}"].concat(), &given),
                        None => text,
                    };
                    Arg { words: Some(scope.params.iter().enumerate().fold(template.clone(), put)), ..told.words }
                }
                _ => told.words,
            };
            Some(Told { kind: told.kind, code, words, next: told.next, status })
        })
    }

    fn call(&mut self, call: &Call) {
        let Some(told) = self.told(call, 3) else { return };
        let before = self.rows.len();
        let said = self
            .words(call.scope, &told.words)
            .or_else(|| self.given(call.scope, &told.words).into_iter().find_map(|arg| arg.words.clone()));
        let words = said.or_else(|| told.next.as_ref().map(|next| format!("… {next}")));
        let Arg { literal, ident, format, is_asked, .. } = &told.code;
        let scope = &self.source.scopes[call.scope];
        match (literal, ident, format) {
            (Some(code), ..) if is_code(code) => self.row(call.scope, code, told.kind.with(told.status.status), words),
            (_, Some(name), _) if is_constant(name) => match self.constant(call.scope, name) {
                Some(code) => self.row(call.scope, &code, told.kind.with(told.status.status), words),
                None => self.offends(call.scope, &format!("{name} is no constant that was read")),
            },
            // Whoever calls this gives the code, or has it from a type.
            (_, Some(name), _) if scope.params.contains(name) => {}
            (_, Some(_), _) => self.variable.entry(call.scope).or_default().push(told),
            (_, _, Some(parts)) => self.built(call.scope, parts, &told),
            _ if *is_asked => {}
            _ => self.offends(call.scope, &format!("what {} is given as a code is none: {literal:?}", call.callee)),
        }
        self.rows.iter_mut().skip(before).for_each(|row| row.is_calm = call.callee == CALM);
    }

    fn row(&mut self, scope: usize, code: &str, kind: Kind, words: Option<String>) {
        let scope = &self.source.scopes[scope];
        let words = words.or_else(|| scope.doc.clone().filter(|_| scope.of == "Failure" || scope.of == "Problem"));
        self.rows.push(Row { code: code.to_owned(), kind, words, is_calm: false });
    }

    /// What the callers of a function give it for one of its parameters.
    fn given(&self, scope: usize, param: &Arg) -> Vec<&'s Arg> {
        let scope = &self.source.scopes[scope];
        let Some(at) = scope.params.iter().position(|name| Some(name) == param.ident.as_ref()) else {
            return Vec::new();
        };
        let calls = self.calls.get(scope.name.as_str()).into_iter().flatten();
        let near = calls.filter(|call| self.source.scopes[call.scope].file == scope.file);
        near.filter_map(|call| call.args.get(at)).collect()
    }

    /// A constant that is a string: of the function, of its file, of any.
    fn constant(&self, scope: usize, name: &str) -> Option<String> {
        let file = |index: usize| &self.source.scopes[index].file;
        let far = |at: usize| {
            if at == scope {
                0
            } else if file(at) == file(scope) {
                1
            } else {
                2
            }
        };
        let named = self.source.consts.iter().filter(|(_, constant, _)| constant == name);
        named.min_by_key(|(at, ..)| far(*at)).map(|(.., text)| text.clone())
    }

    /// The sentence that an argument is.
    fn words(&self, scope: usize, arg: &Arg) -> Option<String> {
        let constant = || self.constant(scope, arg.ident.as_ref().filter(|name| is_constant(name))?);
        arg.words.clone().or_else(constant)
    }

    /// A code of two parts: `{what}.{code}`, where each is given by the function's callers or stands in its tuples.
    fn built(&mut self, scope: usize, parts: &str, told: &Told) {
        let names: Vec<&str> = parts.split('.').filter_map(|part| part.strip_prefix('{')?.strip_suffix('}')).collect();
        let [family, rest] = names[..] else { return self.offends(scope, &format!("the code {parts:?} is built")) };
        let family = Arg { ident: Some(family.to_owned()), ..Arg::default() };
        let families: BTreeSet<String> =
            self.given(scope, &family).into_iter().filter_map(|arg| arg.literal.clone()).collect();
        let bound = self.source.bound.iter().find(|(at, names)| *at == scope && names.iter().any(|name| name == rest));
        let Some((_, bound)) = bound else { return self.offends(scope, &format!("the code {parts:?} is built")) };
        let at = bound.iter().position(|name| name == rest).unwrap_or_default();
        let inside = self.source.seen.iter().filter(|seen| seen.scope == scope);
        let tuples = inside.filter_map(|seen| match seen.place {
            Place::Tuple(tuple, position) if position == at => Some((&seen.text, &self.source.tuples[tuple])),
            _ => None,
        });
        if families.is_empty() {
            self.offends(scope, &format!("the code {parts:?} is built, and nobody gives its first part"));
        }
        for (second, tuple) in tuples.collect::<Vec<_>>() {
            for first in &families {
                self.row(scope, &format!("{first}.{second}"), told.kind.with(status_in(tuple, told)), after(tuple, at));
            }
        }
    }

    /// A code in a tuple, a table or an arm is of what its function, or else its file, hands on under a name.
    fn seen(&mut self, seen: &Seen) {
        let wanted = is_code(&seen.text) && excuse(&seen.text).is_none() && seen.place != Place::Other;
        let scope = &self.source.scopes[seen.scope];
        if !wanted {
            return;
        }
        if scope.name == "code" && seen.place == Place::Bare {
            match CODED.iter().find(|(of, _)| *of == scope.of) {
                Some((_, kind)) => self.row(seen.scope, &seen.text, *kind, self.worded(seen)),
                None => self.offends(seen.scope, &format!("{} is no type of CODED", scope.of)),
            }
            return;
        }
        let near = |(at, _): &(&usize, &Vec<Told>)| self.source.scopes[**at].file == scope.file;
        let told: Vec<&Told> = match self.variable.get(&seen.scope) {
            Some(told) => told.iter().collect(),
            None => self.variable.iter().filter(near).flat_map(|(_, told)| told).collect(),
        };
        let kinds: BTreeSet<Kind> = told.iter().map(|told| told.kind.plain()).collect();
        let (Some(first), 1) = (told.first(), kinds.len()) else { return };
        let (kind, words) = match seen.place {
            Place::Tuple(index, at) => {
                let tuple = &self.source.tuples[index];
                let constants = || tuple.iter().skip(at + 1).find_map(|arg| self.words(seen.scope, arg));
                let error = if kinds.contains(&Kind::Failed) { self.worded(seen) } else { None };
                (
                    first.kind.with(status_in(tuple, first)),
                    error
                        .or_else(|| self.filled(seen.scope, tuple, first))
                        .or_else(|| after(tuple, at))
                        .or_else(constants),
                )
            }
            _ => (first.kind.with(first.status.status), self.words(seen.scope, &first.words)),
        };
        self.row(seen.scope, &seen.text, kind, words);
    }

    /// The sentence that is made of a tuple under the names that a loop or a `let` of the same function gives its elements.
    fn filled(&self, scope: usize, tuple: &[Arg], told: &Told) -> Option<String> {
        let is_its = |(at, names): &&(usize, Vec<String>)| {
            *at == scope
                && names.len() == tuple.len()
                && names.contains(told.code.ident.as_ref().unwrap_or(&String::new()))
        };
        let (_, names) = self.source.bound.iter().find(is_its)?;
        let template = told.words.words.as_ref()?;
        let put = |text: String, (name, arg): (&String, &Arg)| match &arg.literal {
            Some(given) => text.replace(&["{", name, "}"].concat(), given),
            None => text,
        };
        Some(names.iter().zip(tuple).fold(template.clone(), put)).filter(|filled| filled != template)
    }

    /// The sentence of the variant that an arm is for: of its error, of the function `message` beside, of its comment.
    fn worded(&self, seen: &Seen) -> Option<String> {
        let Arm { named, all } = &seen.arm;
        let (here, of) = (&self.source.scopes[seen.scope].file, &self.source.scopes[seen.scope].of);
        let is_message = |other: &&Seen| {
            let scope = &self.source.scopes[other.scope];
            scope.name == "message" && scope.of == *of && scope.file == *here && other.arm == seen.arm
        };
        let message = || self.source.seen.iter().find(is_message).map(|other| other.text.clone());
        named.iter().rev().find_map(|(kind, variant)| {
            let kind = if kind == "Self" { of } else { kind };
            let has = |file: &str, variant: &str| {
                self.source
                    .variants
                    .iter()
                    .find(|found| found.file == file && found.variant == (kind.clone(), variant.to_owned()))
            };
            let files: BTreeSet<&str> = self.source.variants.iter().map(|found| found.file.as_str()).collect();
            let whole = |file: &&str| {
                all.iter().filter(|(other, _)| other == kind).all(|(_, variant)| has(file, variant).is_some())
            };
            let file = files
                .iter()
                .copied()
                .filter(|file| file == here)
                .chain(files.iter().copied())
                .filter(whole)
                .find(|file| has(file, variant).is_some())?;
            let found = has(file, variant)?;
            found.error.clone().or_else(message).or_else(|| found.doc.clone())
        })
    }
}

fn is_constant(name: &str) -> bool {
    name.chars().all(|c| c.is_ascii_uppercase() || c == '_' || c.is_ascii_digit())
}

/// The status that a tuple has, or else the call that it is handed on to.
fn status_in(tuple: &[Arg], told: &Told) -> Option<u16> {
    tuple.iter().find_map(|arg| arg.status).or(told.status.status)
}

/// The first words after the code.
fn after(tuple: &[Arg], at: usize) -> Option<String> {
    tuple.iter().skip(at + 1).find_map(|arg| arg.words.clone())
}

fn files(house: &House) -> Vec<(&str, &str)> {
    house.files.iter().map(|file| (file.name.as_str(), file.text.as_str())).collect()
}

#[test]
fn the_page_of_codes_is_what_the_source_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let house = House::read(root);
    let source = Source::read(&files(&house));
    let reader = Reader::read(&source);
    let codes: BTreeSet<&str> = reader.rows.iter().map(|row| row.code.as_str()).collect();
    let path = root.join("openapi/CODES.md");
    if std::env::var_os(WRITE).is_some() {
        fs::write(&path, page(&reader.rows)).unwrap();
    }
    let excused: BTreeSet<&str> = source.seen.iter().filter_map(|seen| excuse(&seen.text)).collect();
    let stale = NOT_CODES
        .iter()
        .filter(|(what, _)| !excused.contains(what))
        .map(|(what, _)| format!("row {what} of NOT_CODES is stale"));
    let offences: Vec<String> = reader.offences.iter().cloned().chain(stale).collect();
    assert!(offences.is_empty(), "\n{}\n", offences.join("\n"));
    assert!(codes.len() >= FEWEST_CODES, "only {} codes were found", codes.len());
    assert!(
        fs::read_to_string(&path).unwrap_or_default() == page(&reader.rows),
        "openapi/CODES.md is not what the source says: {WRITE}=1 writes it"
    );
}

/// The rows and the offences of one small file.
fn read(text: &str) -> (String, Vec<String>) {
    let source = Source::read(&[("service/small", text)]);
    let reader = Reader::read(&source);
    (page(&reader.rows), reader.offences.into_iter().collect())
}

#[test]
fn a_new_code_is_a_row() {
    let of_match = "fn f(e: E) { let (code, title) = match e { E::A => (\"new.a\", \"A\"), E::B => (\"new.code\", \"Told\") }; \
                    Problem::new(StatusCode::GONE, code, title, d()) }";
    let by_helper = "fn f() { let status = StatusCode::GONE; let no = |code, title| Problem::new(status, code, title, d()); \
                     no(\"new.code\", \"Told\") }";
    let built = "fn of(what: &str) { let (code, title) = match e() { E::A => (\"code\", \"Told\") }; \
                 Problem::new(StatusCode::GONE, format!(\"{what}.{code}\"), title, d()) } fn f() { of(\"new\") }";
    let constant = "const NEW: &str = \"new.code\"; fn f(notices: &mut Notices) { notices.add(NEW, format!(\"Told {} {{.\", 1)); }";
    let flaw = "impl Flaw { fn code(self) -> &'static str { match self { Flaw::A => \"new.code\" } } \
                fn message(self) -> &'static str { match self { Flaw::A => \"Told.\" } } } enum Flaw { A }";
    for (text, row) in [
        ("fn f() { Err(Error::refused(\"new.code\", \"Told.\", \"Do.\")) }", "refusal of a file (422) | Told."),
        ("fn f() { Failure::usage(\"new.code\", error.to_string(), \"Do.\") }", "command line (exit code 2) | … Do."),
        (of_match, "problem (410) | Told"),
        (by_helper, "problem (410) | Told"),
        (built, "problem (410) | Told"),
        (constant, "notice | Told … {."),
        (flaw, "notice | Told."),
    ] {
        let (page, offences) = read(text);
        assert!(page.contains(&format!("\n| `new.code` | {row} |\n")), "{text}: {page}");
        assert_eq!(offences, [""; 0], "{text}");
    }
}

#[test]
fn what_is_not_understood_is_an_offence() {
    for wrong in [
        "fn f() -> &'static str { \"new.code\" }",
        "fn f() { told(\"new.code\") }",
        "fn f() { say!(a => \"new.code\") }",
        "const NEW: &str = \"new.code\";",
        "impl New { fn code(&self) -> &str { \"new.code\" } }",
        "fn f() { Error::refused(\"code\", \"Told.\", \"Do.\") }",
        "fn f() { Error::refused(format!(\"new.{code}\"), \"Told.\", \"Do.\") }",
        "fn f() { Error::refused(NEW, \"Told.\", \"Do.\") }",
    ] {
        assert_ne!(read(wrong).1, [""; 0], "{wrong}");
    }
    for right in [
        "#[cfg(test)] mod tests { const NEW: &str = \"new.code\"; }",
        "fn f(error: &Error) { Failure::failed(error.code(), error.to_string(), \"Do.\") }",
        "fn f() { write(\"report.json\"); crash::point(\"take.committed\") }",
    ] {
        assert_eq!(read(right).1, [""; 0], "{right}");
    }
}
