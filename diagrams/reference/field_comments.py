"""The comments on a dataclass's fields, read from its source."""

import ast
import inspect
import io
import textwrap
import tokenize


def field_comments(kind: type) -> dict[str, str]:
    """By field: the comment at the end of its last line, or else the lines of comment right above it; "" without."""
    source = textwrap.dedent(inspect.getsource(kind))
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = {token.start[0]: token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT}
    alone = {line for line in comments if source.splitlines()[line - 1].lstrip().startswith("#")}
    (body,) = (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    found = {}
    for node in body.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            above, line = list[str](), node.lineno - 1
            while line in alone:
                above.insert(0, comments[line])
                line -= 1
            found[node.target.id] = comments.get(node.end_lineno or node.lineno) or " ".join(above)
    return found
