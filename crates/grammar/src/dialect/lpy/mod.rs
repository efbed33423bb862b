//! Reads models of L-Py: rules, and the statements and expressions of Python that docs/dialects.md lists. A production with
//! `if` becomes one production for each execution path through it.

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
mod execution_path;
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
mod path_code;
mod path_search;
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

/// The line of a production, and the settings of earlier lines that apply to it.
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
    /// Places of string constants, by the names of the model that refer to them.
    texts: BTreeMap<String, Range<usize>>,
    reader: &'r mut Reader<'s>,
    scope: Scope,
    declared: Vec<String>,
    /// Names of the parameters of declared modules.
    module_parameters: BTreeMap<String, Vec<String>>,
    section: Section,
    group: f64,
    /// True if the model calls `useGroup()`.
    uses_groups: bool,
    has_axiom: bool,
    /// Lines of the items that may occur once, by name.
    given: BTreeMap<&'static str, usize>,
    /// True while the statements of the axiom are read, whose loops are unrolled.
    is_in_axiom: bool,
    /// True while statements outside of all productions and functions are read. There, the lists that productions change are
    /// still ordinary lists.
    is_outside_of_blocks: bool,
    /// Number of refused statements of Python that the model needs in order to run.
    refusals: usize,
    /// Code that computes the values of the model before the first step.
    start: Vec<Op>,
    /// Code of the functions that L-Py runs at the beginning, before and after each step.
    functions: RunFunctions,
    /// Names declared `global` by rules and functions.
    shared: Vec<String>,
    /// Initial values of shared names, for items that need a constant.
    initial: BTreeMap<String, f64>,
    /// Number of variables and lists named by this reader. It also counts names used for values of the model, so that no
    /// production reuses a number.
    temporaries: usize,
    /// Functions of statements, by name: their parameters and statements.
    bodies: BTreeMap<String, (Vec<String>, Vec<Statement>)>,
    /// Shapes of the parameters of modules made or matched so far, if the model has lists or vectors as parameters.
    shapes: BTreeMap<String, Vec<Vec<ParamShape>>>,
    /// Attributes of objects that some line of the model sets.
    changed_attributes: BTreeSet<String>,
    /// Shapes of the parameters of modules with lists or vectors, derived from the text.
    written_shapes: BTreeMap<String, Vec<Vec<ParamShape>>>,
    /// Names of all functions of the model, including those defined later in the file.
    defined: BTreeSet<String>,
    /// Line of each function of the model, by name.
    definitions: BTreeMap<String, usize>,
    /// Lists of the model that two names refer to.
    shared_lists: BTreeSet<String>,
    /// Functions that the current production defines.
    own_functions: BTreeMap<String, OwnFunction>,
    /// Places of the loops compiled to code; each block with loops stores a copy.
    loop_places: Vec<SourcePlace>,
    /// Number of parameters that `*args` represents in the current reading of a head.
    star: usize,
    /// Lists in the head of the current rule, by name, each with the list of the model that it hides.
    rule_lists: Vec<(String, Option<PyExpr>)>,
    /// Names of modules and numbers of their parameters in the text.
    arities: BTreeSet<(String, usize)>,
    /// Functions that L-Py runs, to be read once all values of the model are known: name, lines of the body, place.
    run_later: Vec<(String, Range<usize>, Range<usize>)>,
    /// Ignored symbols of contexts: the last list of `ignore` or `consider` before the current line.
    ignored: IgnoredSymbols,
    /// Place of that list, and whether a production follows it.
    ignored_line: Option<(Range<usize>, bool)>,
    /// Productions, to be read once all values and functions of the model are known.
    productions: Vec<ProductionLine>,
    /// Parameters of the function being read, if L-Py runs it: the string and the drawing.
    run_parameters: Vec<String>,
    /// True after `backward()`, false after `forward()`, `None` if neither was called.
    direction: Option<bool>,
}

/// Reads a model of L-Py into the reader's program: sections, rules, and values outside of rules.
pub(super) fn read<'r>(reader: &'r mut Reader<'_>, text: &'r str) {
    // Remove comments and import aliases, and split the text into lines.
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
    // Properties of the whole text that affect how its lines are read.
    model.scope.has_none = ["None", "''", "\"\"", ".get("].iter().any(|text| plain.contains(text));
    model.scope.is_backward = plain.contains("backward()");
    model.scope.direction_changes = run_functions::changes_direction(&list);
    if model.scope.direction_changes {
        model.scope.global(DIRECTION);
    }
    model.shared_names(&list);
    // Read sliders and module names first, because they apply anywhere in the file.
    model.parameters(&list);
    model.classes(&list);
    model.curves(&list);
    model.declarations(&list);
    model.arities = arities(&plain, &model.declared);
    let pieces: Vec<Piece<'_>> = list.iter().map(|l| l.piece).collect();
    model.reader.palette = color::palette(&pieces);
    // Find the shapes of parameters, read the lines in order, then the productions, which use all values of the model.
    model.find_shapes(&list);
    model.lines(&list);
    model.read_productions(&list);
    // Read the functions that L-Py calls itself, such as `StartEach`, last, because they may use all names.
    for (name, body, place) in std::mem::take(&mut model.run_later) {
        // The body may be on the line of the heading: `def Start(): backward()`.
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

/// Names of the functions defined outside of blocks.
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

    /// The string constant at a place of the file, and the offset of its beginning; `None` for other places, and for a
    /// string with a backslash.
    fn quoted(&self, range: Range<usize>) -> Option<(usize, &str)> {
        let text = self.text.get(range.clone())?;
        let quote = text.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        let inner = text.strip_prefix(quote)?.strip_suffix(quote)?;
        (!inner.contains(['\\', quote])).then_some((range.start + 1, inner))
    }

    /// Reports L008 for a repeated item; the last one counts, as in L-Py. `help`: remedy.
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

    /// The symbol of a name: its character, or a private-use character for a longer name.
    fn symbol(&mut self, name: &str) -> Option<SymbolId> {
        let mut chars = name.chars();
        let symbols = &mut self.reader.program.symbols;
        match (chars.next(), chars.next()) {
            (Some(c), None) => symbols.intern(c),
            _ => symbols.private_character(name).and_then(|c| symbols.intern(c)),
        }
    }

    /// Completes the code of functions; none is added after this.
    fn set_run_code(&self) {
        let functions = self.scope.run.borrow();
        let called = functions.iter().map(|f| {
            let code =
                self.scope.with_tables(Bytecode { ops: f.code.clone().unwrap_or_default(), ..Bytecode::default() });
            // Iterations of loops over lists are counted at the source place of the first call of the function.
            let mut code = code;
            if code.ops.iter().any(|op| matches!(op, Op::Count(_))) {
                code.places = vec![self.reader.place(f.place.clone())];
            }
            CalledFunction { parameters: f.parameters, code, place: self.reader.place(f.place.clone()) }
        });
        // The cell is still empty, since only this function sets it.
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
        // Run the code of the model's values first, wherever they are in the file, then that of the function at the beginning of
        // a run.
        append_code(&mut self.start, &self.functions.start);
        let [start, start_each, end_each] =
            [self.start.clone(), self.functions.start_each.clone(), self.functions.end_each.clone()]
                .map(|ops| (!ops.is_empty()).then(|| self.bytecode(ops)));
        let blocks = &mut self.reader.program.blocks;
        blocks.globals = self.scope.array_slots + self.scope.globals.len();
        (blocks.start, blocks.start_each, blocks.end_each) = (start, start_each, end_each);
    }
}
