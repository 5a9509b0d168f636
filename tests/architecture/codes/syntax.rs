//! What an expression, a pattern or an attribute says by itself.

use super::super::reading::is_test;
use super::source::Variant;
use axum::http::StatusCode;
use syn::buffer::TokenBuffer;
use syn::visit::Visit;
use syn::{Expr, Lit, Pat};

/// Modules of `file` that are tests in files of their own.
pub fn test_modules(name: &str, file: &syn::File) -> Vec<String> {
    let prefix = if name == "main" { String::new() } else { format!("{name}/") };
    let tests = file.items.iter().filter_map(|item| match item {
        syn::Item::Mod(item) if is_test(&item.attrs) => Some(format!("{prefix}{}", item.ident)),
        _ => None,
    });
    tests.collect()
}

/// Without what changes only its type.
pub fn stripped(expr: &Expr) -> &Expr {
    match expr {
        Expr::Paren(inner) => stripped(&inner.expr),
        Expr::Group(inner) => stripped(&inner.expr),
        Expr::Reference(inner) => stripped(&inner.expr),
        Expr::MethodCall(call) if ["into", "to_owned", "to_string", "clone"].iter().any(|name| call.method == name) => {
            stripped(&call.receiver)
        }
        _ => expr,
    }
}

/// The string that it is.
pub fn literal(expr: &Expr) -> Option<String> {
    match expr {
        Expr::Lit(syn::ExprLit { lit: Lit::Str(text), .. }) => Some(text.value()),
        _ => None,
    }
}

/// The number that it is.
pub fn int(lit: &Lit) -> Option<u16> {
    if let Lit::Int(number) = lit { number.base10_parse().ok() } else { None }
}

/// What `format!` is given first.
pub fn formatted(expr: &Expr) -> Option<String> {
    let Expr::Macro(found) = expr else { return None };
    let cursor = TokenBuffer::new2(found.mac.tokens.clone());
    let (token, _) = cursor.begin().literal().filter(|_| found.mac.path.is_ident("format"))?;
    if let Lit::Str(text) = Lit::new(token) { Some(text.value()) } else { None }
}

/// The names of a path.
pub fn path(expr: &Expr) -> Option<Vec<String>> {
    let Expr::Path(found) = expr else { return None };
    Some(found.path.segments.iter().map(|segment| segment.ident.to_string()).collect())
}

/// The expressions that one may come to.
pub fn ends(expr: &Expr) -> Vec<&Expr> {
    match stripped(expr) {
        Expr::Match(found) => found.arms.iter().flat_map(|arm| ends(&arm.body)).collect(),
        Expr::If(found) => {
            let other = found.else_branch.iter().flat_map(|(_, other)| ends(other));
            tail(&found.then_branch).into_iter().flat_map(ends).chain(other).collect()
        }
        Expr::Block(found) => tail(&found.block).into_iter().flat_map(ends).collect(),
        end => vec![end],
    }
}

/// What a block says at its end.
pub fn tail(block: &syn::Block) -> Option<&Expr> {
    if let Some(syn::Stmt::Expr(end, None)) = block.stmts.last() { Some(end) } else { None }
}

/// An element of a tuple.
pub fn element(expr: &Expr, at: usize) -> Option<&Expr> {
    if let Expr::Tuple(tuple) = expr { tuple.elems.get(at) } else { None }
}

/// The names that a pattern binds, one for each element of a tuple.
pub fn names(pattern: &Pat) -> Vec<String> {
    match pattern {
        Pat::Ident(found) => vec![found.ident.to_string()],
        Pat::Type(typed) => names(&typed.pat),
        Pat::Tuple(tuple) => tuple.elems.iter().map(|element| names(element).pop().unwrap_or_default()).collect(),
        _ => Vec::new(),
    }
}

/// The variants that a pattern names, outermost first.
pub fn variants(pattern: &Pat) -> Vec<Variant> {
    struct Named(Vec<Variant>);
    impl<'ast> Visit<'ast> for Named {
        fn visit_path(&mut self, path: &'ast syn::Path) {
            let names: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
            if let [.., kind, variant] = names.as_slice() {
                self.0.push((kind.clone(), variant.clone()));
            }
        }
    }
    let mut named = Named(Vec::new());
    named.visit_pat(pattern);
    named.0
}

/// The string that an attribute begins with.
pub fn first_string(attribute: &syn::Attribute) -> Option<String> {
    let syn::Meta::List(list) = &attribute.meta else { return None };
    let (token, _) = TokenBuffer::new2(list.tokens.clone()).begin().literal()?;
    if let Lit::Str(text) = Lit::new(token) { Some(text.value()) } else { None }
}

/// The first line of its comment.
pub fn doc(attributes: &[syn::Attribute]) -> Option<String> {
    let lines = attributes.iter().filter_map(|attribute| match &attribute.meta {
        syn::Meta::NameValue(pair) if pair.path.is_ident("doc") => literal(&pair.value),
        _ => None,
    });
    lines.map(|line| line.trim().to_owned()).find(|line| !line.is_empty())
}

/// The status of that name in `http::StatusCode`.
pub fn status_named(constant: &str) -> Option<u16> {
    let spelt =
        |status: StatusCode| status.canonical_reason().map(|reason| reason.to_uppercase().replace([' ', '-'], "_"));
    (400..600).find(|number| StatusCode::from_u16(*number).ok().and_then(spelt).as_deref() == Some(constant))
}
