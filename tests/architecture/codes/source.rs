//! Reads source files for their strings, and for what stands around each: a call, a tuple, a constant, an arm of a `match`.

use super::super::reading::is_test;
use super::syntax::{
    doc, element, ends, first_string, formatted, int, literal, names, path, status_named, stripped, test_modules,
    variants,
};
use std::collections::BTreeSet;
use syn::buffer::{Cursor, TokenBuffer};
use syn::punctuated::Punctuated;
use syn::visit::{self, Visit};
use syn::{Expr, Lit, Pat, Token};

/// How far names are followed to what they stand for.
const DEPTH: usize = 6;

/// What is known of an argument, an element of a tuple or a field.
#[derive(Clone, Default)]
pub struct Arg {
    /// It is this string.
    pub literal: Option<String>,
    /// It is what has this name.
    pub ident: Option<String>,
    /// It is made by `format!` of this.
    pub format: Option<String>,
    /// It is asked of something else: `error.code()`, `fault.code`.
    pub is_asked: bool,
    /// The sentence that it is, names followed, with its placeholders.
    pub words: Option<String>,
    /// The HTTP status that it is, names followed.
    pub status: Option<u16>,
}

/// A function, a closure with a name, or what is outside of them in a file.
pub struct Scope {
    pub file: String,
    /// Empty outside of functions.
    pub name: String,
    /// The type whose method it is.
    pub of: String,
    pub params: Vec<String>,
    pub doc: Option<String>,
}

/// A call; a struct that is made counts as one: `Check{}`.
pub struct Call {
    pub scope: usize,
    /// `Error::refused`, `wrong`, `.add`.
    pub callee: String,
    /// Last name of what a method is called on.
    pub on: String,
    pub args: Vec<Arg>,
}

/// Where a string stands.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// In a tuple, and where in it.
    Tuple(usize, usize),
    /// Alone: what a `match`, a block or a list says.
    Bare,
    /// In a call, in a comparison, in an attribute, a constant.
    Other,
}

/// A string.
pub struct Seen {
    pub scope: usize,
    pub text: String,
    pub place: Place,
    pub arm: Arm,
}

/// `(enum, variant)`
pub type Variant = (String, String);

/// The arm of a `match` around a string.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Arm {
    /// Variants in its pattern, outermost first.
    pub named: Vec<Variant>,
    /// The outermost of every arm.
    pub all: BTreeSet<Variant>,
}

/// A variant of an enum in words.
pub struct Worded {
    pub file: String,
    pub variant: Variant,
    /// `#[error("..")]`
    pub error: Option<String>,
    pub doc: Option<String>,
}

/// All that was read.
#[derive(Default)]
pub struct Source {
    pub scopes: Vec<Scope>,
    pub calls: Vec<Call>,
    pub tuples: Vec<Vec<Arg>>,
    pub seen: Vec<Seen>,
    /// Constants that are strings, with where they stand.
    pub consts: Vec<(usize, String, String)>,
    /// Names that a `let` or a loop binds, one for each element of a tuple.
    pub bound: Vec<(usize, Vec<String>)>,
    pub variants: Vec<Worded>,
    at: Vec<usize>,
    of: String,
    arms: Vec<Arm>,
    lets: Vec<Vec<(String, Expr, Option<usize>)>>,
}

impl Source {
    /// `(path under src, text)` of each file; tests are left out.
    pub fn read(files: &[(&str, &str)]) -> Source {
        let parsed: Vec<(&str, syn::File)> = files
            .iter()
            .map(|(name, text)| (*name, syn::parse_file(text).unwrap_or_else(|error| panic!("{name}: {error}"))))
            .collect();
        let tests: BTreeSet<String> = parsed.iter().flat_map(|(name, file)| test_modules(name, file)).collect();
        let mut source = Source::default();
        for (name, file) in &parsed {
            let within = |test: &String| {
                name.strip_prefix(test.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
            };
            if !tests.iter().any(within) {
                source.enter(Scope {
                    file: (*name).to_owned(),
                    name: String::new(),
                    of: String::new(),
                    params: Vec::new(),
                    doc: None,
                });
                source.visit_file(file);
                source.at.pop();
            }
        }
        source
    }

    fn enter(&mut self, scope: Scope) {
        self.at.push(self.scopes.len());
        self.scopes.push(scope);
    }

    fn scope(&self) -> usize {
        self.at.last().copied().unwrap_or_default()
    }

    fn see(&mut self, text: String, place: Place) {
        let (scope, arm) = (self.scope(), self.arms.last().cloned().unwrap_or_default());
        self.seen.push(Seen { scope, text, place, arm });
    }

    /// A string is seen in its place; anything else is looked into.
    fn look(&mut self, expr: &Expr, place: Place) {
        match literal(stripped(expr)) {
            Some(text) => self.see(text, place),
            None => self.visit_expr(expr),
        }
    }

    fn arg(&self, expr: &Expr) -> Arg {
        let expr = stripped(expr);
        let is_asked = match expr {
            Expr::MethodCall(call) => call.method == "code",
            Expr::Field(field) => {
                matches!(&field.member, syn::Member::Named(name) if name == "code" || name == "check")
            }
            _ => false,
        };
        Arg {
            literal: literal(expr),
            ident: path(expr).and_then(|mut names| names.pop()),
            format: formatted(expr),
            is_asked,
            words: self.words(expr, DEPTH),
            status: self.status(expr, DEPTH),
        }
    }

    /// What a local name stands for: an expression, or an element of the tuples that it ends in.
    fn local(&self, expr: &Expr) -> Vec<&Expr> {
        let Some(name) = path(expr).filter(|names| names.len() == 1).and_then(|mut names| names.pop()) else {
            return Vec::new();
        };
        let found = self.lets.iter().rev().flat_map(|frame| frame.iter().rev()).find(|(bound, ..)| *bound == name);
        match found {
            Some((_, init, None)) => vec![init],
            Some((_, init, Some(at))) => ends(init).into_iter().filter_map(|end| element(end, *at)).collect(),
            None => Vec::new(),
        }
    }

    fn words(&self, expr: &Expr, depth: usize) -> Option<String> {
        let expr = stripped(expr);
        let deeper = |inner: &Expr| if depth == 0 { None } else { self.words(inner, depth - 1) };
        literal(expr).or_else(|| formatted(expr)).or_else(|| match expr {
            Expr::Path(_) => self.local(expr).into_iter().find_map(deeper),
            Expr::Binary(sum) => deeper(&sum.left),
            Expr::Match(_) | Expr::If(_) | Expr::Block(_) => ends(expr).into_iter().find_map(deeper),
            _ => None,
        })
    }

    fn status(&self, expr: &Expr, depth: usize) -> Option<u16> {
        match stripped(expr) {
            Expr::MethodCall(call) if call.method == "unwrap_or" => self.status(&call.receiver, depth),
            Expr::Call(call) if path(&call.func)?.last()? == "from_u16" => match call.args.first()? {
                Expr::Lit(number) => int(&number.lit),
                _ => None,
            },
            name @ Expr::Path(_) => match path(name)?.as_slice() {
                [.., kind, constant] if kind == "StatusCode" => status_named(constant),
                _ if depth > 0 => self.local(name).into_iter().find_map(|init| self.status(init, depth - 1)),
                _ => None,
            },
            _ => None,
        }
    }

    fn function(&mut self, signature: &syn::Signature, attributes: &[syn::Attribute], visit: impl FnOnce(&mut Source)) {
        let typed = signature.inputs.iter().filter_map(|input| match input {
            syn::FnArg::Typed(typed) => Some(names(&typed.pat).pop().unwrap_or_default()),
            syn::FnArg::Receiver(_) => None,
        });
        let file = self.scopes[self.scope()].file.clone();
        let (name, params) = (signature.ident.to_string(), typed.collect());
        let lets = std::mem::take(&mut self.lets);
        self.enter(Scope { file, name, of: self.of.clone(), params, doc: doc(attributes) });
        visit(self);
        self.at.pop();
        self.lets = lets;
    }

    fn constant(&mut self, name: &syn::Ident, init: &Expr) {
        if let Some(text) = literal(stripped(init)) {
            self.consts.push((self.scope(), name.to_string(), text));
        }
        self.look(init, Place::Other);
    }

    /// Strings among tokens that are no expression.
    fn tokens(&mut self, mut cursor: Cursor<'_>) {
        while !cursor.eof() {
            if let Some((inside, _, _, after)) = cursor.any_group() {
                self.tokens(inside);
                cursor = after;
            } else if let Some((token, after)) = cursor.literal() {
                if let Lit::Str(text) = Lit::new(token) {
                    self.see(text.value(), Place::Other);
                }
                cursor = after;
            } else {
                let Some((_, after)) = cursor.token_tree() else { break };
                cursor = after;
            }
        }
    }
}

impl<'ast> Visit<'ast> for Source {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        let attributes = match item {
            syn::Item::Fn(item) => &item.attrs,
            syn::Item::Impl(item) => &item.attrs,
            syn::Item::Mod(item) => &item.attrs,
            syn::Item::Const(item) => &item.attrs,
            syn::Item::Static(item) => &item.attrs,
            _ => &Vec::new(),
        };
        if !is_test(attributes) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.sig, &item.attrs, |source| visit::visit_item_fn(source, item));
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if !is_test(&item.attrs) {
            self.function(&item.sig, &item.attrs, |source| visit::visit_impl_item_fn(source, item));
        }
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        let of = match &*item.self_ty {
            syn::Type::Path(path) => path.path.segments.last().map(|last| last.ident.to_string()),
            _ => None,
        };
        let outer = std::mem::replace(&mut self.of, of.unwrap_or_default());
        visit::visit_item_impl(self, item);
        self.of = outer;
    }

    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        self.constant(&item.ident, &item.expr);
    }

    fn visit_item_static(&mut self, item: &'ast syn::ItemStatic) {
        self.constant(&item.ident, &item.expr);
    }

    fn visit_impl_item_const(&mut self, item: &'ast syn::ImplItemConst) {
        self.constant(&item.ident, &item.expr);
    }

    fn visit_item_enum(&mut self, item: &'ast syn::ItemEnum) {
        let file = self.scopes[self.scope()].file.clone();
        for variant in &item.variants {
            let named = (item.ident.to_string(), variant.ident.to_string());
            let error =
                variant.attrs.iter().filter(|attribute| attribute.path().is_ident("error")).find_map(first_string);
            self.variants.push(Worded { file: file.clone(), variant: named, error, doc: doc(&variant.attrs) });
        }
        visit::visit_item_enum(self, item);
    }

    fn visit_block(&mut self, block: &'ast syn::Block) {
        self.lets.push(Vec::new());
        visit::visit_block(self, block);
        self.lets.pop();
    }

    fn visit_local(&mut self, local: &'ast syn::Local) {
        let bound = names(&local.pat);
        let Some(init) = &local.init else { return };
        if let (Expr::Closure(closure), [name]) = (&*init.expr, bound.as_slice()) {
            let params = closure.inputs.iter().map(|input| names(input).pop().unwrap_or_default()).collect();
            let Scope { file, .. } = &self.scopes[self.scope()];
            self.enter(Scope { file: file.clone(), name: name.clone(), of: String::new(), params, doc: None });
            self.visit_expr(&closure.body);
            self.at.pop();
            return;
        }
        self.look(&init.expr, Place::Bare);
        init.diverge.iter().for_each(|(_, other)| self.visit_expr(other));
        let is_tuple = matches!(local.pat, Pat::Tuple(_));
        let stands = |(at, name): (usize, &String)| (name.clone(), (*init.expr).clone(), is_tuple.then_some(at));
        self.lets.last_mut().into_iter().for_each(|frame| frame.extend(bound.iter().enumerate().map(stands)));
        self.bound.push((self.scope(), bound));
    }

    fn visit_expr_for_loop(&mut self, found: &'ast syn::ExprForLoop) {
        self.bound.push((self.scope(), names(&found.pat)));
        visit::visit_expr_for_loop(self, found);
    }

    fn visit_expr_match(&mut self, found: &'ast syn::ExprMatch) {
        self.visit_expr(&found.expr);
        let patterns: Vec<Vec<Variant>> = found.arms.iter().map(|arm| variants(&arm.pat)).collect();
        let all: BTreeSet<Variant> = patterns.iter().filter_map(|named| named.first()).cloned().collect();
        for (arm, named) in found.arms.iter().zip(patterns) {
            let outer = self.arms.last().filter(|_| named.is_empty()).cloned();
            self.arms.push(outer.unwrap_or(Arm { named, all: all.clone() }));
            self.visit_pat(&arm.pat);
            arm.guard.iter().for_each(|(_, guard)| self.visit_expr(guard));
            self.look(&arm.body, Place::Bare);
            self.arms.pop();
        }
    }

    fn visit_pat(&mut self, pattern: &'ast Pat) {
        match pattern {
            Pat::Lit(found) => {
                literal(&Expr::Lit(found.clone())).into_iter().for_each(|text| self.see(text, Place::Other))
            }
            _ => visit::visit_pat(self, pattern),
        }
    }

    fn visit_expr_call(&mut self, call: &'ast syn::ExprCall) {
        let names = path(&call.func).unwrap_or_default();
        let callee = names[names.len().saturating_sub(2)..].join("::");
        let wraps = matches!(callee.as_str(), "Some" | "Ok" | "Err");
        self.visit_expr(&call.func);
        call.args.iter().for_each(|arg| self.look(arg, if wraps { Place::Bare } else { Place::Other }));
        let args = call.args.iter().map(|arg| self.arg(arg)).collect();
        self.calls.push(Call { scope: self.scope(), callee, on: String::new(), args });
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        let on = match &*call.receiver {
            Expr::Field(syn::ExprField { member: syn::Member::Named(name), .. }) => name.to_string(),
            other => path(other).and_then(|mut names| names.pop()).unwrap_or_default(),
        };
        self.look(&call.receiver, Place::Bare);
        call.args.iter().for_each(|arg| self.look(arg, Place::Other));
        let args = call.args.iter().map(|arg| self.arg(arg)).collect();
        self.calls.push(Call { scope: self.scope(), callee: format!(".{}", call.method), on, args });
    }

    fn visit_expr_struct(&mut self, made: &'ast syn::ExprStruct) {
        let name = made.path.segments.last().map(|last| last.ident.to_string()).unwrap_or_default();
        let field = |wanted: &[&str]| {
            let is = |field: &&syn::FieldValue| matches!(&field.member, syn::Member::Named(name) if wanted.iter().any(|one| name == one));
            made.fields.iter().find(is).map(|field| self.arg(&field.expr))
        };
        if let Some(code) = field(&["code", "check"]) {
            let args = vec![code, field(&["title", "message"]).unwrap_or_default()];
            self.calls.push(Call { scope: self.scope(), callee: format!("{name}{{}}"), on: String::new(), args });
        }
        made.fields.iter().for_each(|field| self.look(&field.expr, Place::Other));
        made.rest.iter().for_each(|rest| self.visit_expr(rest));
    }

    fn visit_expr_tuple(&mut self, tuple: &'ast syn::ExprTuple) {
        let index = self.tuples.len();
        let args = tuple.elems.iter().map(|element| self.arg(element)).collect();
        self.tuples.push(args);
        tuple.elems.iter().enumerate().for_each(|(at, element)| self.look(element, Place::Tuple(index, at)));
    }

    fn visit_expr_binary(&mut self, binary: &'ast syn::ExprBinary) {
        [&binary.left, &binary.right].into_iter().for_each(|side| self.look(side, Place::Other));
    }

    fn visit_lit_str(&mut self, text: &'ast syn::LitStr) {
        self.see(text.value(), Place::Bare);
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        match &attribute.meta {
            syn::Meta::List(list) => self.tokens(TokenBuffer::new2(list.tokens.clone()).begin()),
            syn::Meta::NameValue(pair) if !pair.path.is_ident("doc") => self.look(&pair.value, Place::Other),
            _ => {}
        }
    }

    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        match item.parse_body_with(Punctuated::<Expr, Token![,]>::parse_terminated) {
            Ok(inside) => inside.iter().for_each(|expr| self.look(expr, Place::Bare)),
            Err(_) => self.tokens(TokenBuffer::new2(item.tokens.clone()).begin()),
        }
    }
}
