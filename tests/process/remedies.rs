//! What the code tells people to do can be done: every flag, verb, route, parameter, option and header that a sentence of it
//! names is there. The sentences are read from the source, so that a new one is judged too.

use crate::server::{Server, lampwright};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// A sentence that the code can print, and where it stands.
struct Sentence {
    file: String,
    text: String,
}

/// The literals of a source file, its tests left out: comments are no literals, a line that goes on is one.
fn literals(source: &str) -> Vec<String> {
    let source = source.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let (mut found, mut rest) = (Vec::new(), source);
    while let Some(at) = rest.find(['"', '/', '\'', 'r']) {
        let (before, from) = (rest.as_bytes().get(at.wrapping_sub(1)).copied().unwrap_or(b' '), &rest[at..]);
        let in_word = before.is_ascii_alphanumeric() || before == b'_';
        rest = if from.starts_with("//") {
            &from[from.find('\n').unwrap_or(from.len())..]
        } else if let Some(raw) = from.strip_prefix('r').filter(|raw| !in_word && raw.starts_with(['"', '#'])) {
            let hashes = raw.len() - raw.trim_start_matches('#').len();
            let Some(raw) = raw[hashes..].strip_prefix('"') else {
                rest = &raw[hashes..];
                continue;
            };
            let end = format!("\"{}", "#".repeat(hashes));
            let (literal, after) = raw.split_once(&end).unwrap_or((raw, ""));
            found.push(literal.to_owned());
            after
        } else if let Some(after) = from.strip_prefix('"') {
            let end = closing(after);
            found.push(unescaped(&after[..end]));
            after.get(end + 1..).unwrap_or_default()
        } else if from.starts_with("'\"'") || from.starts_with("'\\\"'") {
            &from[from[1..].find('\'').map_or(1, |end| end + 2)..]
        } else {
            &from[1..]
        };
    }
    found
}

/// Where a literal ends that begins at the start of `text`.
fn closing(text: &str) -> usize {
    let mut escaped = false;
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = true,
            b'"' => return at,
            _ => {}
        }
    }
    text.len()
}

fn unescaped(literal: &str) -> String {
    let mut lines = literal.split("\\\n").map(str::trim_start);
    let first = literal.split("\\\n").next().unwrap_or_default().to_owned();
    lines.next();
    lines.fold(first, |all, line| all + line).replace("\\\"", "\"").replace("\\n", "\n")
}

fn read(folder: &Path, all: &mut Vec<Sentence>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            read(&path, all);
        } else if path.extension().is_some_and(|kind| kind == "rs") && !path.ends_with("tests.rs") {
            let file = path.strip_prefix(env!("CARGO_MANIFEST_DIR")).unwrap().display().to_string();
            let literals = literals(&fs::read_to_string(&path).unwrap());
            all.extend(literals.into_iter().map(|text| Sentence { file: file.clone(), text }));
        }
    }
}

/// Every sentence of the source: it begins with a capital (or a value) and has several words; SQL is none.
fn sentences() -> Vec<Sentence> {
    const SQL: [&str; 8] = ["SELECT", "INSERT", "UPDATE", "DELETE", "PRAGMA", "SET ", "CAST(", "AND "];
    let mut all = Vec::new();
    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut all);
    let is_sentence = |text: &str| {
        text.contains(' ')
            && text.starts_with(|first: char| {
                first.is_uppercase() || "{?`".contains(first) || text.contains("lampwright ")
            })
            && !SQL.iter().any(|word| text.starts_with(word))
    };
    all.retain(|sentence| is_sentence(&sentence.text));
    all
}

/// Words between what cannot be part of one.
fn words(text: &str, part: impl Fn(char) -> bool) -> impl Iterator<Item = &str> {
    text.split(move |letter: char| !part(letter)).filter(|word| !word.is_empty())
}

/// The help of a verb and of all below it: (verb, help).
fn help(verb: &[&str], all: &mut Vec<(String, String)>) {
    let mut arguments = verb.to_vec();
    arguments.push("--help");
    let text = String::from_utf8(lampwright(&arguments).stdout).unwrap();
    let commands = text.split_once("Commands:\n").map_or("", |(_, rest)| rest.split("\n\n").next().unwrap_or_default());
    for line in commands.lines() {
        if let Some(name) = line.split_whitespace().next().filter(|name| *name != "help" && line.starts_with("  ")) {
            help(&[verb, &[name]].concat(), all);
        }
    }
    all.push((verb.join(" "), text));
}

fn manual() -> Vec<(String, String)> {
    let mut all = Vec::new();
    help(&[], &mut all);
    all
}

fn contract() -> Value {
    serde_json::from_slice(&lampwright(&["openapi"]).stdout).unwrap()
}

/// Flags as a text names them.
fn flags(text: &str) -> impl Iterator<Item = &str> {
    words(text, |letter| letter.is_ascii_alphanumeric() || letter == '-')
        .filter(|word| word.starts_with("--") && word.len() > 2 && word.as_bytes()[2].is_ascii_lowercase())
}

#[test]
fn every_flag_and_verb_that_a_sentence_names_is_there() {
    // Other programs have flags of their own.
    const FOREIGN: [&str; 4] = ["curl ", "zstd's ", "docker ", "chown "];
    let manual = manual();
    assert!(manual.len() > 12, "{:?}", manual.iter().map(|(verb, _)| verb).collect::<Vec<_>>());
    let has = |help: &str, flag: &str| flags(help).any(|known| known == flag);
    let mut named = 0;
    for Sentence { file, text } in
        sentences().iter().filter(|sentence| !FOREIGN.iter().any(|word| sentence.text.contains(word)))
    {
        for flag in flags(text) {
            named += 1;
            assert!(manual.iter().any(|(_, help)| has(help, flag)), "{file}: no verb has {flag}: {text}");
        }
        // "serve --auth on", "lampwright keys create --tenant NAME", "lampwright keys list names them".
        for (verb, _) in manual.iter().filter(|(verb, _)| !verb.is_empty()) {
            for (at, _) in text.match_indices(&format!("{verb} --")) {
                let flag = flags(&text[at..]).next().unwrap();
                let of_verb = manual.iter().any(|(known, help)| known.ends_with(verb.as_str()) && has(help, flag));
                assert!(of_verb, "{file}: {verb} has no {flag}: {text}");
            }
        }
        for (at, _) in text.match_indices("lampwright ") {
            let after: Vec<&str> =
                words(&text[at + "lampwright ".len()..], |letter| letter.is_ascii_lowercase()).collect();
            let verb = manual.iter().any(|(verb, _)| !verb.is_empty() && after.join(" ").starts_with(verb.as_str()));
            let is_name = !text[at + "lampwright ".len()..].starts_with(|letter: char| letter.is_ascii_lowercase());
            assert!(verb || is_name, "{file}: no such verb: {text}");
        }
    }
    assert!(named > 20, "only {named} flags were found: this test looks in the wrong place");
}

/// Headers that HTTP itself has; ours are in the contract.
const HTTP: [&str; 11] = [
    "Allow",
    "Authorization",
    "Content-Disposition",
    "Content-Encoding",
    "Content-Length",
    "Content-Type",
    "Host",
    "If-Match",
    "If-None-Match",
    "Retry-After",
    "Transfer-Encoding",
];

/// Names of parameters and, in lower case, of headers that the contract and HTTP have.
fn known_names(contract: &Value) -> (BTreeSet<String>, BTreeSet<String>) {
    let mut parameters = BTreeSet::new();
    let mut headers: BTreeSet<String> = HTTP.iter().map(|name| name.to_lowercase()).collect();
    for operation in contract["paths"].as_object().unwrap().values().flat_map(|item| item.as_object().unwrap().values())
    {
        for parameter in operation["parameters"].as_array().into_iter().flatten() {
            let name = parameter["name"].as_str().unwrap();
            parameters.insert(name.to_owned());
            headers.insert(name.to_lowercase());
        }
        for response in operation["responses"].as_object().unwrap().values() {
            headers.extend(response["headers"].as_object().into_iter().flatten().map(|(name, _)| name.to_lowercase()));
        }
    }
    (parameters, headers)
}

#[test]
fn every_route_parameter_option_and_header_that_a_sentence_names_is_there() {
    let contract = contract();
    let (parameters, headers) = known_names(&contract);
    let paths: Vec<Vec<&str>> =
        contract["paths"].as_object().unwrap().keys().map(|path| path.split('/').collect()).collect();
    let is_route = |path: &str| {
        let asked: Vec<&str> = path.split('/').collect();
        let fits = |known: &&Vec<&str>| {
            known.len() == asked.len()
                && known.iter().zip(&asked).all(|(known, asked)| known == asked || known.starts_with('{'))
        };
        ["/docs", "/openapi.json"].contains(&path) || paths.iter().any(|known| fits(&known))
    };
    let options = contract["components"]["schemas"]["JobOptions"]["properties"].as_object().unwrap();
    let is_option = |group: &str, name: &str| {
        let reference = options[group]["$ref"].as_str().or(options[group]["oneOf"][0]["$ref"].as_str()).unwrap();
        !contract.pointer(&format!("{}/properties/{name}", &reference[1..])).unwrap_or(&Value::Null).is_null()
    };
    let mut named = (0, 0, 0);
    for Sentence { file, text } in &sentences() {
        for path in words(text, |letter| letter.is_ascii_alphanumeric() || "/-_.{}".contains(letter)) {
            let path = path.strip_prefix("{site}").unwrap_or(path).trim_end_matches(['.', '/']);
            if path.starts_with("/v1/") || path.starts_with("/docs") || path.starts_with("/openapi") {
                named.0 += 1;
                assert!(is_route(path), "{file}: no such route {path}: {text}");
            }
            if let Some((group, name)) = path.split_once('.')
                && options.contains_key(group)
                && !name.contains('/')
            {
                named.1 += 1;
                assert!(is_option(group, name), "{file}: no such option {path}: {text}");
            }
        }
        for (at, _) in text.match_indices('?') {
            if let Some((name, _)) = text[at + 1..].split_once('=').filter(|(name, _)| !name.contains(' ')) {
                assert!(parameters.contains(name), "{file}: no such parameter {name}: {text}");
            }
        }
        for word in words(text, |letter| letter.is_ascii_alphanumeric() || letter == '-') {
            let parts: Vec<&str> = word.split('-').collect();
            let capital = |part: &&str| {
                part.len() > 1
                    && part.as_bytes()[0].is_ascii_uppercase()
                    && part[1..].bytes().all(|b| b.is_ascii_lowercase())
            };
            if parts.len() > 1 && parts.iter().all(capital) {
                named.2 += 1;
                assert!(headers.contains(&word.to_lowercase()), "{file}: no such header {word}: {text}");
            }
        }
    }
    assert!(named.0 >= 2 && named.1 >= 8 && named.2 >= 10, "only {named:?} were found");
}

#[test]
fn addresses_of_stores_are_refused_with_those_that_are_taken_and_those_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let refused = |arguments: &[&str], known: &[&str]| {
        let output = lampwright(
            &[
                arguments,
                &["--data", &path("data"), "--listen", "127.0.0.1:0"][..if arguments[0] == "serve" { 4 } else { 2 }],
            ]
            .concat(),
        );
        let told = String::from_utf8(output.stderr).unwrap();
        let remedy = told.split("  do     ").nth(1).unwrap_or_default().to_owned();
        assert!(!output.status.success() && known.iter().all(|word| remedy.contains(word)), "{told}");
    };
    for verb in [&["serve"][..], &["keys", "list"]] {
        refused(
            &[verb, &["--database-url", "mysql://root@localhost/rays"]].concat(),
            &["sqlite:FILE", "postgres://", "DATABASE_URL"],
        );
    }
    refused(&["serve", "--storage-url", "gs://bucket"], &["file:FOLDER", "s3://BUCKET", "STORAGE_URL"]);
    // As the remedies write it: a file that is not there yet is made.
    let database = format!("sqlite:{}", path("new.db"));
    let made = lampwright(&["keys", "list", "--database-url", &database, "--data", &path("data")]);
    assert!(made.status.success(), "{made:?}");
    assert!(folder.path().join("new.db").is_file());
}

#[test]
fn literals_are_read_as_rust_has_them() {
    let source = "a(\"b \\\"c\\\" \\\n   d\"); // \"no\"\nlet r = 'x'; r#\"raw \"q\" e\"#; let q = '\"'; for_r(\"f\");\n\
                  #[cfg(test)]\nmod tests { \"g\" }";
    assert_eq!(literals(source), ["b \"c\" d", "raw \"q\" e", "f"]);
}

/// The remedy of an empty upload, given to a shell as it stands.
#[test]
fn the_call_that_sends_a_file_sends_it() {
    if std::process::Command::new("curl").arg("--version").output().is_err() {
        println!("LEFT OUT: curl is not installed");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(&folder.path().join("data"), &["--no-sample"]);
    let refused = server.post("/v1/ray-sets", "application/octet-stream", b"").json();
    let remedy = refused["remedy"].as_str().unwrap_or_else(|| panic!("{refused}"));
    let words =
        remedy.rsplit(" as ").next().and_then(|call| call.split(" does").next()).unwrap_or_else(|| panic!("{remedy}"));
    let file = folder.path().join("led.dat");
    fs::write(&file, support::rays::zemax(9)).unwrap();
    let url = format!("http://{}/v1/ray-sets", server.address);
    let call: Vec<String> = words
        .split(' ')
        .map(|word| match word {
            "FILE" => file.display().to_string(),
            "URL" => url.clone(),
            other => other.to_owned(),
        })
        .collect();
    let sent =
        std::process::Command::new(&call[0]).args(&call[1..]).args(["-s", "-w", "%{http_code}"]).output().unwrap();
    let answer = String::from_utf8(sent.stdout).unwrap();
    assert!(answer.ends_with("201"), "{call:?}: {answer}");
}
