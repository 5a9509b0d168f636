//! The page of codes as Markdown.

use std::collections::{BTreeMap, BTreeSet};

/// What the page begins with.
const INTRODUCTION: &str = "\
# Stable codes

Whatever is refused, repaired, judged or failed has a code besides its sentence: `family.what`. Programs may depend on the codes: one that
is here keeps its meaning, and a new one is no breaking change. Titles and sentences are for people and may be reworded; where one code
has several, the first is here. `…` stands for what is filled in.

| what it is | where it is met |
| --- | --- |
| problem | the answer to a request (`application/problem+json`): `code`, and `type` is `urn:lampwright:problem:<code>`; in brackets its HTTP status |
| failure of a job | `problem.code` of a job that has failed |
| malformed file; refusal of a file; options or declaration that cannot be used | a fault of what was sent: a problem with the status in brackets, the failure of a job, a file of an upload that is left out (`left_out`), or on the command line with exit code 1, 1 and 2 |
| notice | `notices`: of a job, a ray set, a spectrum, in `report.json` |
| check of an inspection | `check` in `inspection.checks`, whatever the verdict; a job has it as a notice where the verdict is not `ok` and no other code tells it |
| command line | `lampwright` on standard error; in brackets its exit code |

This page is made from the source and never edited: `LAMPWRIGHT_WRITE_CODES=1 cargo test --test architecture codes` writes it; without
the variable the test compares.
";

/// What a code is. Of several, the first has the words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Problem(Option<u16>),
    Job,
    Malformed,
    Refused,
    Unusable,
    Notice,
    Check,
    Failed,
    Usage,
}

impl Kind {
    /// In the page.
    pub fn says(self) -> String {
        match self {
            Kind::Problem(Some(status)) => return format!("problem ({status})"),
            Kind::Problem(None) => "problem",
            Kind::Job => "failure of a job",
            Kind::Malformed => "malformed file (400)",
            Kind::Refused => "refusal of a file (422)",
            Kind::Unusable => "options or declaration that cannot be used (422)",
            Kind::Notice => "notice",
            Kind::Check => "check of an inspection",
            Kind::Failed => "command line (exit code 1)",
            Kind::Usage => "command line (exit code 2)",
        }
        .to_owned()
    }

    /// The same with its status, if it has one.
    pub fn with(self, status: Option<u16>) -> Kind {
        if let Kind::Problem(_) = self { Kind::Problem(status) } else { self }
    }

    /// The same, whatever the status.
    pub fn plain(self) -> Kind {
        self.with(None)
    }
}

/// One code, as it is said in one place.
pub struct Row {
    pub code: String,
    pub kind: Kind,
    pub words: Option<String>,
    /// It says that nothing is the matter: what it says otherwise goes before.
    pub is_calm: bool,
}

/// The page.
pub fn page(rows: &[Row]) -> String {
    let mut families: BTreeMap<&str, BTreeMap<&str, Vec<&Row>>> = BTreeMap::new();
    for row in rows {
        let family = row.code.split('.').next().unwrap_or_default();
        families.entry(family).or_default().entry(&row.code).or_default().push(row);
    }
    let mut page = INTRODUCTION.to_owned();
    for (family, codes) in families {
        page += &format!("\n## {family}\n\n| code | what it is | in words |\n| --- | --- | --- |\n");
        for (code, mut rows) in codes {
            rows.sort_by_key(|row| row.is_calm);
            let kinds: BTreeSet<Kind> = rows.iter().map(|row| row.kind).collect();
            let kinds: Vec<String> = kinds.into_iter().map(Kind::says).collect();
            page += &format!("| `{code}` | {} | {} |\n", kinds.join("; "), in_words(&rows));
        }
    }
    page
}

/// Titles side by side, or the first sentence.
fn in_words(rows: &[&Row]) -> String {
    let Some(first) = rows.iter().min_by_key(|row| row.kind.plain()) else { return String::new() };
    let same = rows.iter().filter(|row| row.kind.plain() == first.kind.plain());
    let said_once = matches!(first.kind, Kind::Job | Kind::Check);
    let mut said: Vec<String> = Vec::new();
    for words in same.filter_map(|row| row.words.as_deref()).map(open) {
        if !said.contains(&words) {
            said.push(words);
        }
    }
    let titles: Vec<String> = said.iter().filter(|words| !words.ends_with(['.', '…'])).cloned().collect();
    match said.into_iter().next() {
        Some(first) if titles.is_empty() || said_once => first,
        _ => titles.join("; "),
    }
}

/// Without placeholders, on one line, fit for a table.
fn open(template: &str) -> String {
    let mut said = String::new();
    let mut rest = template;
    while let Some((before, inside)) = rest.split_once('{') {
        said += before;
        rest = match inside.strip_prefix('{') {
            Some(after) => {
                said.push('{');
                after
            }
            None => {
                said.push('…');
                inside.split_once('}').map_or("", |(_, after)| after)
            }
        };
    }
    let said = (said + rest).replace("}}", "}").replace('|', "\\|").replace('<', "&lt;");
    said.split_whitespace().collect::<Vec<_>>().join(" ")
}
