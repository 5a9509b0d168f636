//! Reads source files as syntax: every path in `use` lines, code, attributes and macro tokens, with where it leads.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use syn::buffer::{Cursor, TokenBuffer};
use syn::visit::{self, Visit};

/// The folders that are packages of their own; everything else is the package of the command line.
const PACKAGES: [&str; 2] = ["pipeline", "service"];

/// Where a path leads.
#[derive(Debug, PartialEq)]
pub enum Target {
    /// Into one of our packages. `named`: as written, from `src`; `origin`: with re-exports followed to where the item is defined.
    Ours { named: String, origin: String },
    /// Into another crate, from its name on.
    Foreign(String),
    /// Not a path: `async` or `await`.
    Async,
}

/// One path in one file.
pub struct Found {
    /// The file under `src`, without `.rs` and `/mod`.
    pub file: String,
    /// Inside `#[cfg(test)]`.
    pub in_test: bool,
    /// It only hands a name on: `pub use`.
    pub is_reexport: bool,
    /// Where it leads.
    pub target: Target,
}

impl Found {
    /// A line for a person.
    pub fn says(&self, complaint: &str) -> String {
        format!("src/{}: {:?} {complaint}", self.file, self.target)
    }
}

/// One source file.
pub struct File {
    /// Path under the folder read, without `.rs`, `/mod` and `/lib`: its module path with slashes.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// All source files, read.
pub struct House {
    /// The files.
    pub files: Vec<File>,
    /// Every path in them.
    pub found: Vec<Found>,
    /// What `pipeline/lib.rs` defines or re-exports publicly, modules apart.
    pub front_door: BTreeSet<String>,
    /// Files with a `#[path]` attribute.
    pub moved: Vec<String>,
    /// Module name → file, of every `mod` item.
    modules: Vec<(String, String)>,
    /// Every module.
    known: BTreeSet<Module>,
}

type Module = Vec<String>;

/// A path as written, before it is resolved.
struct Raw {
    file: String,
    module: Module,
    in_test: bool,
    segments: Vec<String>,
    is_use: bool,
    is_reexport: bool,
}

#[derive(Default)]
struct Reader {
    file: String,
    module: Module,
    in_test: bool,
    is_reexport: bool,
    raw: Vec<Raw>,
    awaits: Vec<Found>,
    /// Name → path as written, for each module.
    imports: BTreeMap<Module, BTreeMap<String, Vec<String>>>,
    known: BTreeSet<Module>,
    /// Modules under `#[cfg(test)]`, which may be files of their own.
    tests: BTreeSet<Module>,
    crates: BTreeSet<String>,
    modules: Vec<(String, String)>,
    front_door: BTreeSet<String>,
    moved: Vec<String>,
}

impl House {
    /// Everything under `src`.
    pub fn read(root: &Path) -> House {
        House::read_folder(root, "src")
    }

    /// Everything under a folder of the repository.
    pub fn read_folder(root: &Path, folder: &str) -> House {
        let mut texts = Vec::new();
        gather(&root.join(folder), "", &mut texts);
        let texts: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
        House::from_texts(&texts)
    }

    /// `(path under src without .rs, text)` of each file.
    pub fn from_texts(texts: &[(&str, &str)]) -> House {
        let mut reader = Reader { crates: declared_crates(), ..Reader::default() };
        let mut files = Vec::new();
        for (path, text) in texts {
            let name = path.strip_suffix("/mod").or(path.strip_suffix("/lib")).unwrap_or(path).to_owned();
            reader.module = if *path == "main" { Vec::new() } else { name.split('/').map(str::to_owned).collect() };
            reader.known.insert(reader.module.clone());
            reader.file.clone_from(&name);
            let syntax = syn::parse_file(text).unwrap_or_else(|error| panic!("{path}: {error}"));
            reader.visit_file(&syntax);
            files.push(File { name, text: (*text).to_owned() });
        }
        let mut found: Vec<Found> = reader.raw.iter().filter_map(|raw| reader.resolve(raw)).collect();
        found.append(&mut reader.awaits);
        let Reader { front_door, moved, modules, known, .. } = reader;
        House { files, found, front_door, moved, modules, known }
    }

    /// Whether a path with slashes is that of a module.
    pub fn is_module(&self, path: &str) -> bool {
        self.known.contains(&path.split('/').map(str::to_owned).collect::<Module>())
    }

    /// Names of the modules that `file` declares.
    pub fn modules_in<'a>(&'a self, file: &'a File) -> impl Iterator<Item = &'a String> {
        self.modules.iter().filter(|(_, place)| *place == file.name).map(|(name, _)| name)
    }
}

fn gather(folder: &Path, prefix: &str, into: &mut Vec<(String, String)>) {
    let mut entries: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap()).collect();
    entries.sort_by_key(|entry| entry.file_name());
    for entry in entries {
        let name = entry.file_name().into_string().unwrap();
        if entry.file_type().unwrap().is_dir() {
            gather(&entry.path(), &format!("{prefix}{name}/"), into);
        } else if let Some(stem) = name.strip_suffix(".rs") {
            into.push((format!("{prefix}{stem}"), fs::read_to_string(entry.path()).unwrap()));
        }
    }
}

impl Reader {
    fn add(&mut self, segments: Vec<String>, is_use: bool) {
        let (file, module, in_test, is_reexport) =
            (self.file.clone(), self.module.clone(), self.in_test, self.is_reexport);
        self.raw.push(Raw { file, module, in_test, segments, is_use, is_reexport });
    }

    fn add_async(&mut self) {
        let (file, in_test) = (self.file.clone(), self.in_test);
        self.awaits.push(Found { file, in_test, is_reexport: false, target: Target::Async });
    }

    fn import(&mut self, name: &str, path: Vec<String>) {
        self.imports.entry(self.module.clone()).or_default().insert(name.to_owned(), path);
    }

    /// Flattens `a::{b, c as d, self, *}`.
    fn flatten(&mut self, tree: &syn::UseTree, mut prefix: Vec<String>, public: bool) {
        match tree {
            syn::UseTree::Path(path) => {
                prefix.push(path.ident.to_string());
                self.flatten(&path.tree, prefix, public);
            }
            syn::UseTree::Group(group) => {
                group.items.iter().for_each(|item| self.flatten(item, prefix.clone(), public))
            }
            syn::UseTree::Name(name) => self.leaf(&name.ident, &name.ident, prefix, public),
            syn::UseTree::Rename(rename) => self.leaf(&rename.ident, &rename.rename, prefix, public),
            syn::UseTree::Glob(_) => {
                prefix.push("*".to_owned());
                self.add(prefix, true);
            }
        }
    }

    fn leaf(&mut self, ident: &syn::Ident, rename: &syn::Ident, mut path: Vec<String>, public: bool) {
        if ident != "self" || path.is_empty() {
            path.push(ident.to_string());
        }
        let visible = if rename == "self" { path.last().cloned().unwrap_or_default() } else { rename.to_string() };
        self.import(&visible, path.clone());
        if public && self.module == ["pipeline"] {
            self.front_door.insert(visible);
        }
        self.add(path, true);
    }

    /// `a::b::c` and `async` inside macros and attributes, where there are only tokens.
    fn tokens(&mut self, mut cursor: Cursor<'_>) {
        let mut path: Vec<String> = Vec::new();
        let mut colons = 0;
        while !cursor.eof() {
            if let Some((inside, _, _, after)) = cursor.any_group() {
                self.finish(&mut path);
                self.tokens(inside);
                cursor = after;
            } else if let Some((ident, after)) = cursor.ident() {
                if ident == "async" || ident == "await" {
                    self.add_async();
                }
                if colons != 2 {
                    self.finish(&mut path);
                }
                path.push(ident.to_string());
                (colons, cursor) = (0, after);
            } else if let Some((punct, after)) = cursor.punct() {
                colons = if punct.as_char() == ':' { colons + 1 } else { 3 };
                cursor = after;
            } else {
                self.finish(&mut path);
                let Some((_, after)) = cursor.token_tree() else { break };
                cursor = after;
            }
        }
        self.finish(&mut path);
    }

    fn finish(&mut self, path: &mut Vec<String>) {
        let segments = std::mem::take(path);
        if segments.len() > 1 {
            self.add(segments, false);
        }
    }

    fn resolve(&self, raw: &Raw) -> Option<Found> {
        let target = match self.absolute(&raw.module, &raw.segments, raw.is_use, 0)? {
            Absolute::Foreign(path) => Target::Foreign(path.join("::")),
            Absolute::Ours(named) => match self.origin(&named, 0) {
                Absolute::Ours(origin) => Target::Ours { named: named.join("::"), origin: origin.join("::") },
                Absolute::Foreign(path) => Target::Foreign(path.join("::")),
            },
        };
        let in_test = raw.in_test || (0..=raw.module.len()).any(|end| self.tests.contains(&raw.module[..end]));
        Some(Found { file: raw.file.clone(), in_test, is_reexport: raw.is_reexport, target })
    }

    /// From the root of a crate. `None`: a type or value of the file itself.
    fn absolute(&self, module: &[String], segments: &[String], is_use: bool, depth: usize) -> Option<Absolute> {
        let (first, rest) = segments.split_first()?;
        let below = |base: &[String], rest: &[String]| Absolute::Ours([base, rest].concat());
        match first.as_str() {
            // A package is called by the name of its folder.
            "crate" => {
                let is_package = module.first().is_some_and(|top| PACKAGES.contains(&top.as_str()));
                return Some(below(&module[..usize::from(is_package)], rest));
            }
            name if PACKAGES.contains(&name) && !self.known.contains(&[module, segments].concat()) => {
                return Some(below(&[], segments));
            }
            "self" => return Some(below(module, rest)),
            "super" => {
                let parent = &module[..module.len().saturating_sub(1)];
                let more = rest.first().is_some_and(|next| next == "super");
                return if more { self.absolute(parent, rest, is_use, depth) } else { Some(below(parent, rest)) };
            }
            _ => {}
        }
        let imported = self.imports.get(module).and_then(|names| names.get(first));
        if let Some(path) = imported.filter(|path| path.first() != Some(first) && depth < 8) {
            return self.absolute(module, &[path, rest].concat(), true, depth + 1);
        }
        if self.known.contains(&[module, std::slice::from_ref(first)].concat()) {
            return Some(below(module, segments));
        }
        let declared = self.crates.contains(first);
        let crate_like = is_use && first.starts_with(char::is_lowercase);
        (declared || crate_like).then(|| Absolute::Foreign(segments.to_vec()))
    }

    /// Follows re-exports: the first name of the path that a module on the way imports is replaced by what it imports.
    fn origin(&self, path: &[String], depth: usize) -> Absolute {
        for at in 0..path.len() {
            let (module, rest) = path.split_at(at);
            let into_module = self.known.contains(&path[..=at]);
            let import = self.imports.get(module).and_then(|names| names.get(&rest[0]));
            if let (false, Some(import), true) = (into_module, import, depth < 8) {
                return match self.absolute(module, &[import, &rest[1..]].concat(), true, 0) {
                    Some(Absolute::Ours(next)) if next != path => self.origin(&next, depth + 1),
                    Some(foreign @ Absolute::Foreign(_)) => foreign,
                    _ => Absolute::Ours(path.to_vec()),
                };
            }
        }
        Absolute::Ours(path.to_vec())
    }
}

enum Absolute {
    Ours(Vec<String>),
    Foreign(Vec<String>),
}

/// Crates that a path may begin with: the standard ones and every dependency in one of the `Cargo.toml`.
fn declared_crates() -> BTreeSet<String> {
    let mut names: BTreeSet<String> = ["std", "core", "alloc"].map(str::to_owned).into();
    let mut listed = false;
    let manifests = [
        include_str!("../../Cargo.toml"),
        include_str!("../../src/pipeline/Cargo.toml"),
        include_str!("../../src/service/Cargo.toml"),
    ];
    for line in manifests.into_iter().flat_map(str::lines) {
        if line.starts_with('[') {
            listed = line.ends_with("dependencies]");
        } else if let (true, Some((name, _))) = (listed, line.split_once(" = ")) {
            names.insert(name.trim_end_matches(".workspace").replace('-', "_"));
        }
    }
    names
}

/// Whether it is there in tests only.
pub fn is_test(attributes: &[syn::Attribute]) -> bool {
    let test = |attribute: &syn::Attribute| {
        attribute.path().is_ident("cfg") && attribute.parse_args::<syn::Path>().is_ok_and(|path| path.is_ident("test"))
    };
    attributes.iter().any(test)
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.is_reexport = matches!(item.vis, syn::Visibility::Public(_));
        self.flatten(&item.tree, Vec::new(), self.is_reexport);
        self.is_reexport = false;
    }

    fn visit_item_extern_crate(&mut self, item: &'ast syn::ItemExternCrate) {
        self.add(vec![item.ident.to_string()], true);
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        let name = item.ident.to_string();
        self.modules.push((name.clone(), self.file.clone()));
        let was_test = self.in_test;
        self.in_test |= is_test(&item.attrs);
        self.module.push(name);
        self.known.insert(self.module.clone());
        if self.in_test {
            self.tests.insert(self.module.clone());
        }
        visit::visit_item_mod(self, item);
        self.module.pop();
        self.in_test = was_test;
    }

    fn visit_item(&mut self, item: &'ast syn::Item) {
        let named = match item {
            syn::Item::Fn(item) => Some((&item.vis, &item.sig.ident)),
            syn::Item::Struct(item) => Some((&item.vis, &item.ident)),
            syn::Item::Enum(item) => Some((&item.vis, &item.ident)),
            syn::Item::Trait(item) => Some((&item.vis, &item.ident)),
            syn::Item::Type(item) => Some((&item.vis, &item.ident)),
            syn::Item::Const(item) => Some((&item.vis, &item.ident)),
            _ => None,
        };
        if let Some((syn::Visibility::Public(_), ident)) = named.filter(|_| self.module == ["pipeline"]) {
            self.front_door.insert(ident.to_string());
        }
        visit::visit_item(self, item);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let segments: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        if segments.len() > 1 {
            self.add(segments, false);
        }
        visit::visit_path(self, path);
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        if attribute.path().is_ident("path") {
            self.moved.push(self.file.clone());
        }
        if let syn::Meta::List(list) = &attribute.meta {
            self.tokens(TokenBuffer::new2(list.tokens.clone()).begin());
        }
        visit::visit_attribute(self, attribute);
    }

    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        self.tokens(TokenBuffer::new2(item.tokens.clone()).begin());
        visit::visit_macro(self, item);
    }

    fn visit_signature(&mut self, signature: &'ast syn::Signature) {
        if signature.asyncness.is_some() {
            self.add_async();
        }
        visit::visit_signature(self, signature);
    }

    fn visit_expr_async(&mut self, expression: &'ast syn::ExprAsync) {
        self.add_async();
        visit::visit_expr_async(self, expression);
    }

    fn visit_expr_await(&mut self, expression: &'ast syn::ExprAwait) {
        self.add_async();
        visit::visit_expr_await(self, expression);
    }
}
