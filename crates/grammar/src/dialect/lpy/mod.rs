//! Models of L-Py: rules, and of Python the statements and expressions that docs/dialects.md lists. A production with `if` becomes one
//! production for each way through it.

mod arrays;
mod assignment;
mod attempts;
mod block;
mod bounds;
mod changed_lists;
mod color;
mod curve_table;
mod curves;
mod dictionary;
mod emit;
mod expression;
mod functions;
mod headings;
mod imports;
mod lines;
mod lists;
mod loops;
mod objects;
mod param_shape;
mod parser;
mod pieces;
mod python;
mod refusal;
mod resolve;
mod rule;
mod run_functions;
mod scope;
mod shapes;
mod shared_lists;
mod statement;
mod strings;
mod vectors;
mod way;
mod way_code;
mod ways;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use self::emit::append_code;
use self::expression::PyExpr;
use self::lines::{Line, description, line_of, without_comments};
use self::param_shape::ParamShape;
use self::pieces::{colon, parameters_of, statements_of_line};
use self::refusal::Refusal;
use self::rule::arities;
use self::run_functions::RunFunctions;
use self::scope::{OwnFunction, Scope};
use self::statement::{DIRECTION, GROUP, Statement};
use crate::code::{Bytecode, CalledFunction, Op};
use crate::dialect::Reader;
use crate::dialect::text::{Piece, lines};
use crate::program::IgnoredSymbols;
use crate::symbols::SymbolId;
use crate::token::SourcePlace;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    Header,
    Rules,
    Decomposition,
    Interpretation,
}

/// The line of a production, and what of the lines before holds for it.
#[derive(Debug)]
struct ProductionLine {
    index: usize,
    section: Section,
    group: f64,
    ignored: IgnoredSymbols,
}

struct Model<'r, 's> {
    /// The text of the file.
    text: &'r str,
    /// Places of the texts in quotes that names of the model stand for.
    texts: BTreeMap<String, Range<usize>>,
    reader: &'r mut Reader<'s>,
    scope: Scope,
    declared: Vec<String>,
    /// Names of the parameters of declared modules.
    module_parameters: BTreeMap<String, Vec<String>>,
    section: Section,
    group: f64,
    /// The model calls `useGroup()`.
    uses_groups: bool,
    has_axiom: bool,
    /// Lines of the items that a model has once, by their names.
    given: BTreeMap<&'static str, usize>,
    /// The statements that are read are those of the axiom: their loops are written out.
    is_in_axiom: bool,
    /// The statements that are read are no block of a production or function: lists that these change are lists there.
    is_outside_of_blocks: bool,
    /// Number of statements of Python that the model could not run without.
    refusals: usize,
    /// What the values of the model compute before the first step.
    start: Vec<Op>,
    /// Functions that L-Py runs: at the beginning, before and after each step.
    functions: RunFunctions,
    /// Names that rules and functions declare `global`.
    shared: Vec<String>,
    /// Values of shared names before the first step, for items that need a constant.
    initial: BTreeMap<String, f64>,
    /// How many variables and lists this reader has named. Values of the model are among them, so that no production uses a number again.
    temporaries: usize,
    /// Functions that are more than one expression, by name: their parameters and statements.
    bodies: BTreeMap<String, (Vec<String>, Vec<Statement>)>,
    /// Parameters of modules that have been made or met in heads, where the model has lists or vectors as parameters.
    shapes: BTreeMap<String, Vec<Vec<ParamShape>>>,
    /// Attributes of objects that some line of the model sets.
    changed_attributes: BTreeSet<String>,
    /// Written shapes of the parameters of modules that have lists or vectors.
    written_shapes: BTreeMap<String, Vec<Vec<ParamShape>>>,
    /// Names of all functions of the model, also of those that stand further down.
    defined: BTreeSet<String>,
    /// Lines of the functions of the model, by their names.
    definitions: BTreeMap<String, usize>,
    /// Lists of the model that have two names.
    shared_lists: BTreeSet<String>,
    /// Functions that the production which is read defines.
    own_functions: BTreeMap<String, OwnFunction>,
    /// Places of the loops that run as code, which each block with loops has a copy of.
    loop_places: Vec<SourcePlace>,
    /// How many parameters `*args` stands for in the present reading of a head.
    star: usize,
    /// Lists that the head of the present rule names, with those of the model that have these names.
    rule_lists: Vec<(String, Option<PyExpr>)>,
    /// Names and numbers of parameters of modules as the text has them.
    arities: BTreeSet<(String, usize)>,
    /// Lines of the functions that L-Py runs, which are read when all values of the model are known: name, first and last line
    /// of the body, place.
    run_later: Vec<(String, Range<usize>, Range<usize>)>,
    /// What contexts skip: the last list of `ignore` or `consider` before the line that is read.
    ignored: IgnoredSymbols,
    /// The line of that list, and whether a production follows it.
    ignored_line: Option<(Range<usize>, bool)>,
    /// Productions, which are read when all values and functions of the model are known.
    productions: Vec<ProductionLine>,
    /// Parameters of the function that is read, which L-Py runs: the string, and what was drawn.
    run_parameters: Vec<String>,
    /// `backward()` was called, or `forward()`; `None`: neither.
    direction: Option<bool>,
}

/// Reads a model of L-Py into the reader's program: sections, rules, and values computed outside of rules.
pub(super) fn read<'r>(reader: &'r mut Reader<'_>, text: &'r str) {
    // Remove comments and import aliases, and divide the text into lines.
    reader.description = description(text);
    let plain = imports::without_aliases(&without_comments(text));
    let list: Vec<Line<'_>> = lines(&plain).filter_map(line_of).collect();
    reader.program.length = 1;
    let source = Some(reader.source);
    let mut model = Model {
        text,
        texts: BTreeMap::new(),
        reader,
        scope: Scope { source, ..Scope::default() },
        declared: Vec::new(),
        module_parameters: BTreeMap::new(),
        section: Section::Header,
        group: 0.0,
        uses_groups: plain.contains("useGroup("),
        has_axiom: false,
        given: BTreeMap::new(),
        is_in_axiom: false,
        is_outside_of_blocks: false,
        refusals: 0,
        start: Vec::new(),
        functions: RunFunctions::default(),
        shared: Vec::new(),
        initial: BTreeMap::new(),
        temporaries: 0,
        bodies: BTreeMap::new(),
        shapes: BTreeMap::new(),
        changed_attributes: BTreeSet::new(),
        written_shapes: BTreeMap::new(),
        defined: function_names(&list),
        definitions: BTreeMap::new(),
        shared_lists: BTreeSet::new(),
        own_functions: BTreeMap::new(),
        loop_places: Vec::new(),
        star: 0,
        rule_lists: Vec::new(),
        arities: BTreeSet::new(),
        run_later: Vec::new(),
        ignored: IgnoredSymbols::Nothing,
        ignored_line: None,
        productions: Vec::new(),
        run_parameters: Vec::new(),
        direction: None,
    };
    // Lists that change take the first slots of variables.
    model.find_changed_lists(&list);
    if model.uses_groups {
        model.scope.global(GROUP);
    }
    // Properties of the whole text, on which the reading of its lines depends.
    model.scope.has_none = ["None", "''", "\"\"", ".get("].iter().any(|text| plain.contains(text));
    model.scope.is_backward = plain.contains("backward()");
    model.scope.direction_changes = run_functions::changes_direction(&list);
    if model.scope.direction_changes {
        model.scope.global(DIRECTION);
    }
    model.shared_names(&list);
    // Sliders and module names first: L-Py knows them wherever the file has them.
    model.parameters(&list);
    model.classes(&list);
    model.curves(&list);
    model.declarations(&list);
    model.arities = arities(&plain, &model.declared);
    let pieces: Vec<Piece<'_>> = list.iter().map(|l| l.piece).collect();
    model.reader.palette = color::palette(&pieces);
    // Then the shapes of parameters, the lines in order, and the productions, which see all values of the model.
    model.find_shapes(&list);
    model.lines(&list);
    model.read_productions(&list);
    // Functions that L-Py calls itself, such as `StartEach`, come last: they may use all names.
    for (name, body, place) in std::mem::take(&mut model.run_later) {
        // The body may stand on the line of the head: `def Start(): backward()`.
        let head = body.start.checked_sub(1).and_then(|i| list.get(i)).map(|l| l.piece);
        let inline =
            head.and_then(|h| colon(h).map(|c| statements_of_line(h.from(c + 1).trimmed()))).unwrap_or_default();
        let inline: Vec<Line<'_>> = inline.into_iter().map(|piece| Line { indent: 1, piece }).collect();
        let block = if inline.is_empty() { list.get(body).unwrap_or(&[]) } else { &inline };
        let parameters = head.and_then(parameters_of).unwrap_or_default();
        model.run_parameters = parameters.into_iter().map(|(name, _)| name).collect();
        model.called_function(&name, block, &place);
    }
    model.finish(text);
}

/// Names of the functions that lines define outside of blocks.
fn function_names(list: &[Line<'_>]) -> BTreeSet<String> {
    let name = |line: &Line<'_>| {
        let (word, rest) = line.piece.first_word(&[]);
        let is_definition = word.text == "def" && line.indent == 0;
        is_definition.then(|| rest.text.split('(').next().unwrap_or("").trim().to_owned())
    };
    list.iter().filter_map(name).collect()
}

impl Model<'_, '_> {
    fn refuse(&mut self, why: &Refusal) {
        self.refusals += 1;
        let place = self.reader.place(why.range.clone());
        let line = self.reader.line_number(why.range.start);
        let message = format!("this is L-Py with Python code, line {line}: {}", why.construct);
        let help = why.remedy.unwrap_or(
            "osier reads rules, expressions, lists, dictionaries, functions with a value, 'if', 'for' and 'while'; pass what a \
             production needs as parameters of its modules",
        );
        self.reader.session.error_help("L007", message, place, help);
    }

    /// A text in quotes of the file, and where it begins; `None` for a place that is none, or one with a backslash.
    fn quoted(&self, range: Range<usize>) -> Option<(usize, &str)> {
        let text = self.text.get(range.clone())?;
        let quote = text.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        let inner = text.strip_prefix(quote)?.strip_suffix(quote)?;
        (!inner.contains(['\\', quote])).then_some((range.start + 1, inner))
    }

    /// Reports L008 for an item that occurs twice; the last one counts, as in L-Py. `help`: what to do about it.
    fn second(&mut self, item: &'static str, piece: Piece<'_>, help: &str) {
        let line = self.reader.line_number(piece.at);
        let Some(first) = self.given.insert(item, line) else { return };
        let place = self.reader.place(piece.range());
        let message = format!("{item} in line {line} replaces the one in line {first}");
        self.reader.session.warning("L008", message, place, help);
    }

    fn settle<T>(&mut self, result: Result<T, Refusal>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(why) => {
                self.refuse(&why);
                None
            }
        }
    }

    /// The symbol of a name: its character, or a private one for a longer name.
    fn symbol(&mut self, name: &str) -> Option<SymbolId> {
        let mut chars = name.chars();
        let symbols = &mut self.reader.program.symbols;
        match (chars.next(), chars.next()) {
            (Some(c), None) => symbols.intern(c),
            _ => symbols.private_character(name).and_then(|c| symbols.intern(c)),
        }
    }

    /// Sets the code of the functions that run as code: none is added from here on.
    fn set_run_code(&self) {
        let functions = self.scope.run.borrow();
        let called = functions.iter().map(|f| {
            let code =
                self.scope.with_tables(Bytecode { ops: f.code.clone().unwrap_or_default(), ..Bytecode::default() });
            // Loops over lists count at the place of their first call.
            let mut code = code;
            if code.ops.iter().any(|op| matches!(op, Op::Count(_))) {
                code.places = vec![self.reader.place(f.place.clone())];
            }
            CalledFunction { parameters: f.parameters, code, place: self.reader.place(f.place.clone()) }
        });
        // Nothing has set it before.
        self.scope.run_code.get_or_init(|| called.collect());
    }

    fn finish(mut self, text: &str) {
        if !self.has_axiom && self.refusals == 0 {
            let piece = Piece::new(0, &text[..text.find(['\n', '\r']).unwrap_or(text.len())]);
            let place = self.reader.place(piece.range());
            let help = "write: Axiom: F";
            self.reader.session.error_help("L003", "the model has no axiom".into(), place, help);
        }
        self.keep_productions_of_direction();
        self.share_ignored_symbols();
        self.set_run_code();
        self.reader.program.curves = self.scope.curves.borrow().tables();
        // Values of the model first, wherever they are written, then the function that begins a run.
        append_code(&mut self.start, &self.functions.start);
        let [start, start_each, end_each] =
            [self.start.clone(), self.functions.start_each.clone(), self.functions.end_each.clone()]
                .map(|ops| (!ops.is_empty()).then(|| self.bytecode(ops)));
        let blocks = &mut self.reader.program.blocks;
        blocks.globals = self.scope.array_slots + self.scope.globals.len();
        (blocks.start, blocks.start_each, blocks.end_each) = (start, start_each, end_each);
    }
}
