"""The certified L1 optimum: least absolute residuals in a box, with a dual bound that proves it.

Primal-dual interior point for L1 regression as in Portnoy and Koenker 1997, with the predictor and corrector of
Mehrotra 1992; a step costs one product W' D W of b columns. Many rows are cut first, another idea of Portnoy and
Koenker: a fit to a sample of the rows tells the sign of most residuals, and a row of known sign is only a linear term.
Every result, however it came about, is judged by its certificate alone. HiGHS takes over ten times as long on 75 000
rows (see benchmarks/speed/rows/colony.py); it steps in where the interior point stalls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.optimize
import scipy.sparse

from dynident.arrays import Array, BoolArray, frozen
from dynident.errors import SolverFailed
from dynident.model.threads import one_blas_thread

#: Largest relative gap between objective and lower bound of a certified optimum.
GAP = 1e-6

_TARGET = 1e-9  # relative gap that ends the interior point
_STEPS = 80
_PANEL = 2048  # rows of W' D W at a time: the panel stays in the cache
_SAMPLE = 4000  # rows of the first fit; fewer than three times as many rows are solved in full
_DOUBT = 0.25  # share of the rows whose sign that fit leaves in doubt
_ROUNDS = 6
_SEED = 1997


@dataclass(frozen=True)
class LeastAbsolute:
    """A certified minimum of sum_i w_i |tau - W beta|_i over a box.

    Attributes:
        beta: Minimiser, inside the box, shape (b,).
        objective: F at ``beta``.
        lower_bound: No beta in the box has a smaller objective; from ``dual`` alone.
        gap: (objective - lower_bound) / objective; where the objective is below a millionth of that of beta = 0 or a
            1e-12th of what the corners of the box reach (a perfect fit), relative to that.
        dual: y with |y_i| <= w_i that proves the bound, shape (r,).
    """

    beta: Array
    objective: float
    lower_bound: float
    gap: float
    dual: Array


def least_absolute(
    matrix: npt.ArrayLike, target: npt.ArrayLike, weights: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> LeastAbsolute:
    """Minimise sum_i w_i |tau - W beta|_i over lower <= beta <= upper.

    Args:
        matrix: W, shape (r, b); columns that are contiguous in memory save a copy.
        target: tau, shape (r,).
        weights: w >= 0, shape (r,).
        lower: Lower bounds, finite, shape (b,).
        upper: Upper bounds, finite, shape (b,).

    Raises:
        ValueError: A shape is wrong, a value is not finite, a weight is negative or a lower bound is above its upper.
        SolverFailed: The gap that the certificate proves is above :data:`GAP`.
    """
    fit = _checked(matrix, target, weights, lower, upper)
    with one_blas_thread():
        found = _certified(fit, *primal_and_dual(fit))
    if not found.gap <= GAP:
        found = _certified(fit, *linear_program(fit))  # slower, and at home where the interior point stalls
    if not found.gap <= GAP:
        objective, bound, gap = found.objective, found.lower_bound, found.gap
        raise SolverFailed(
            "the least absolute residual fit",
            f"objective {objective:.6g}, proven lower bound {bound:.6g}, relative gap {gap:.2g}",
            "check the units of the log and the width of the box, or use the norm l2",
        )
    return found


def _certified(fit: _Fit, beta: Array, dual: Array) -> LeastAbsolute:
    """Return a solution with the gap that its dual proves."""
    objective = float(fit.weights @ np.abs(fit.residual(beta)))
    bound = dual_bound(fit.columns.T, fit.target, fit.weights, fit.lower, fit.upper, dual)
    bound = min(max(bound, 0.0), objective)  # F >= 0, and rounding may put the bound of a perfect optimum above it
    gap = (objective - bound) / max(objective, _perfect(fit))
    return LeastAbsolute(frozen(beta), objective, bound, gap, frozen(dual))


def linear_program(fit: _Fit) -> tuple[Array, Array]:
    """Return beta and the dual by HiGHS: minimise w'(u + v) with W beta + u - v = tau; zeros where it fails."""
    count, rows = fit.columns.shape
    one = scipy.sparse.identity(rows)
    found = scipy.optimize.linprog(
        np.concatenate([np.zeros(count), fit.weights, fit.weights]),
        A_eq=scipy.sparse.hstack([scipy.sparse.csr_matrix(fit.columns.T), one, -one]),
        b_eq=fit.target,
        bounds=[*zip(fit.lower, fit.upper, strict=True), *[(0, None)] * (2 * rows)],
        method="highs",
    )
    if found.x is None:
        return np.clip(np.zeros(count), fit.lower, fit.upper), np.zeros(rows)
    return np.clip(found.x[:count], fit.lower, fit.upper), np.asarray(found.eqlin.marginals)


def dual_bound(matrix: Array, target: Array, weights: Array, lower: Array, upper: Array, dual: Array) -> float:
    """Return a lower bound of the objective over the box: y' tau - sum_j max((W'y)_j l_j, (W'y)_j u_j).

    It holds for every y with |y_i| <= w_i, since then w_i |e_i| >= y_i e_i; ``dual`` is clipped to that first.
    """
    y = np.clip(dual, -weights, weights)
    pull = matrix.T @ y
    return float(y @ target - np.sum(np.maximum(pull * lower, pull * upper)))


@dataclass(frozen=True)
class _Fit:
    """The rows as columns (b, r), with a linear term: minimise sum_i w_i |tau - W beta|_i - pull' beta in the box."""

    columns: Array
    target: Array
    weights: Array
    lower: Array
    upper: Array
    pull: Array

    def residual(self, beta: Array) -> Array:
        return self.target - beta @ self.columns

    def part(self, keep: BoolArray, signs: Array) -> _Fit:
        """Return the fit to the rows in ``keep``, the others linear with the given signs."""
        fixed = np.where(keep, 0.0, self.weights * signs)
        return _Fit(
            np.ascontiguousarray(self.columns[:, keep]),
            self.target[keep],
            self.weights[keep],
            self.lower,
            self.upper,
            self.pull + self.columns @ fixed,
        )


def _checked(
    matrix: npt.ArrayLike, target: npt.ArrayLike, weights: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> _Fit:
    given = np.asarray(matrix, dtype=np.float64)
    if given.ndim != 2 or not given.size:
        raise ValueError(f"matrix has shape {given.shape}, expected (r, b) with at least one row and column")
    rows, count = given.shape
    tau, w = frozen(target, (rows,), "target"), frozen(weights, (rows,), "weights")
    low, high = frozen(lower, (count,), "lower"), frozen(upper, (count,), "upper")
    for name, values in (("matrix", given), ("target", tau), ("weights", w), ("lower", low), ("upper", high)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} has a value that is not finite")
    if w.min() < 0:
        raise ValueError(f"weight {int(np.argmin(w))} is {w.min():g}, expected 0 or more")
    if np.any(low > high):
        j = int(np.argmax(low - high))
        raise ValueError(f"bound {j}: the lower one, {low[j]:g}, is above the upper one, {high[j]:g}")
    return _Fit(np.ascontiguousarray(given.T), tau, w, low, high, np.zeros(count))


def _perfect(fit: _Fit) -> float:
    """Return the objective below which a fit is perfect, since rounding is not far; above zero."""
    corners = np.maximum(np.abs(fit.lower), np.abs(fit.upper)) @ np.linalg.norm(fit.columns, axis=1)
    reach = float(corners * np.linalg.norm(fit.weights))
    return max(1e-6 * float(fit.weights @ np.abs(fit.target)), 1e-12 * reach, 1e-200)


def primal_and_dual(fit: _Fit) -> tuple[Array, Array]:
    """Return (beta, dual): rows without weight and columns without room are left out, then many rows are cut."""
    rows, free = fit.weights > 0, fit.lower < fit.upper
    beta = np.array(fit.lower)
    if not rows.any() or not free.any():
        return beta, fit.weights * np.sign(fit.residual(beta))
    if not rows.all() or not free.all():
        rest = fit.residual(np.where(free, 0.0, beta))[rows]
        columns = np.ascontiguousarray(fit.columns[np.ix_(free, rows)])
        inner = _Fit(columns, rest, fit.weights[rows], fit.lower[free], fit.upper[free], fit.pull[free])
        dual = np.zeros(len(rows))
        beta[free], dual[rows] = primal_and_dual(inner)
        return beta, dual
    if len(rows) < 3 * _SAMPLE:
        return _InteriorPoint(fit).run()
    return solve_doubtful(fit) or _InteriorPoint(fit).run()


def solve_doubtful(fit: _Fit) -> tuple[Array, Array] | None:
    """Solve with the rows whose sign is in doubt only; None where the signs do not settle."""
    rows = len(fit.target)
    sample = np.random.default_rng(_SEED).choice(rows, _SAMPLE, replace=False)
    columns = np.ascontiguousarray(fit.columns[:, sample])
    pull = fit.pull * (_SAMPLE / rows)
    share = _Fit(columns, fit.target[sample], fit.weights[sample], fit.lower, fit.upper, pull)
    residual = fit.residual(_InteriorPoint(share).run()[0])
    signs = np.sign(residual)
    doubt = np.abs(residual) / _prediction_error(fit.columns, columns)
    keep = doubt <= np.quantile(doubt, _DOUBT)
    for _ in range(_ROUNDS):
        part = fit.part(keep, signs)
        beta, inner = _InteriorPoint(part).run()
        wrong = ~keep & (fit.residual(beta) * signs < 0)
        if not wrong.any():
            dual = fit.weights * signs
            dual[keep] = inner
            return beta, dual
        keep = keep | wrong
        if np.mean(keep) > 0.6:
            break
    return None


def _prediction_error(columns: Array, sample: Array) -> Array:
    """Return how far a fit to the sample is off at each row, up to a common factor: the root of the row's leverage."""
    norms = np.linalg.norm(sample, axis=1)
    scale = 1.0 / np.where(norms > 0, norms, 1.0)[:, None]
    gram = (sample * scale) @ (sample * scale).T + 1e-9 * np.eye(len(sample))
    root = np.linalg.inv(np.linalg.cholesky(gram)) * scale.T
    square = np.concatenate(
        [np.sum((root @ columns[:, k : k + _PANEL]) ** 2, axis=0) for k in range(0, columns.shape[1], _PANEL)]
    )
    return np.sqrt(np.maximum(square, np.finfo(float).tiny))


class _InteriorPoint:
    """residual = p - n; slacks sp = w - y and sn = w + y; distances dl, du to the box and their multipliers zl, zu.

    Every iterate is feasible on both sides (W'y + pull = zu - zl), so the sum of the products is the gap. Columns are
    scaled to unit norm, weights to an objective of one.
    """

    def __init__(self, fit: _Fit) -> None:
        self._columns = fit.columns
        norms = np.sqrt(np.einsum("ij,ij->i", fit.columns, fit.columns))
        self._norms = np.where(norms > 0, norms, 1.0)
        self._low, self._high = fit.lower, fit.upper
        low, high = fit.lower * self._norms, fit.upper * self._norms
        room = 0.01 * (high - low)
        self.beta = np.clip(self._least_squares(fit.target), low + room, high - room)
        self.dl, self.du = self.beta - low, high - self.beta
        residual = fit.target - self._times(self.beta)
        floor = _perfect(fit)
        self._scale = max(float(fit.weights @ np.abs(residual)), floor)
        self._floor = floor / self._scale
        self._w = w = fit.weights / self._scale
        # Central on the rows: p sp = n sn = mu with p - n = r has y = r w^2 / (mu + sqrt(mu^2 + r^2 w^2)).
        mu = 0.5 / len(w)
        away = np.abs(residual)
        small = mu / (w + away * w**2 / (mu + np.hypot(mu, away * w)))
        large, positive = small + away, residual > 0
        self.p, self.n = np.where(positive, large, small), np.where(positive, small, large)
        self.sp, self.sn = mu / self.p, mu / self.n
        self._pull = fit.pull / self._scale / self._norms
        slope = self._slope()
        self.zl = np.maximum(-slope, 0.0) + mu / np.minimum(self.dl, self.du)
        self.zu = self.zl + slope

    def run(self) -> tuple[Array, Array]:
        """Iterate and return (beta, dual); whether they are good is for the certificate to say."""
        stalled, length = 0, 1.0
        for _ in range(_STEPS):
            gap = self._gap()
            objective = max(float(self._w @ (self.p + self.n)), self._floor)
            if gap <= _TARGET * objective or stalled == 8:
                break
            length = self._step(gap, cautious=length < 0.2)
            stalled = stalled + 1 if self._gap() > 0.9 * gap else 0
        return np.clip(self.beta / self._norms, self._low, self._high), 0.5 * (self.sn - self.sp) * self._scale

    def _gap(self) -> float:
        return float(self.p @ self.sp + self.n @ self.sn + self.dl @ self.zl + self.du @ self.zu)

    def _step(self, gap: float, cautious: bool) -> float:
        """Take one predictor-corrector step, or one towards the centre if cautious; return its length."""
        ip, jn = 1.0 / self.sp, 1.0 / self.sn
        d = 1.0 / (self.p * ip + self.n * jn)
        drift = self.zu - self.zl - self._slope()  # zero but for rounding
        solve = _solver(self._gram(d) + np.diag(self.zl / self.dl + self.zu / self.du))

        def direction(rp: Array, rn: Array, rl: Array, ru: Array) -> _Direction:
            shift = rp * ip - rn * jn
            beta = solve(rl / self.dl - ru / self.du - self._transposed(d * shift) - drift)
            y = -d * (self._times(beta) + shift)
            zl, zu = (rl - self.zl * beta) / self.dl, (ru + self.zu * beta) / self.du
            return _Direction(beta, y, (rp + self.p * y) * ip, (rn - self.n * y) * jn, zl, zu)

        products = (self.p * self.sp, self.n * self.sn, self.dl * self.zl, self.du * self.zu)
        mean = gap / (2 * len(d) + 2 * len(self.beta))
        if cautious:
            step = direction(*(0.5 * mean - product for product in products))
        else:
            ahead = direction(*(-product for product in products))
            mu = mean * (max(self._reached(ahead), 0.0) / gap) ** 3
            seconds = (-ahead.p * ahead.y, ahead.n * ahead.y, ahead.beta * ahead.zl, -ahead.beta * ahead.zu)
            step = direction(*(mu - product - second for product, second in zip(products, seconds, strict=True)))
        primal, dual = (min(1.0, 0.9995 * length) for length in self._lengths(step))
        self._move(step, primal, dual)
        return min(primal, dual)

    def _reached(self, ahead: _Direction) -> float:
        """Return the gap after the longest step along ``ahead``."""
        primal, dual = self._lengths(ahead)
        rows = (self.p + primal * ahead.p) @ (self.sp - dual * ahead.y)
        rows += (self.n + primal * ahead.n) @ (self.sn + dual * ahead.y)
        box = (self.dl + primal * ahead.beta) @ (self.zl + dual * ahead.zl)
        box += (self.du - primal * ahead.beta) @ (self.zu + dual * ahead.zu)
        return float(rows + box)

    def _lengths(self, step: _Direction) -> tuple[float, float]:
        """Return the longest primal and dual steps, up to 1, that keep every iterate >= 0."""
        primal = ((self.p, step.p), (self.n, step.n), (self.dl, step.beta), (self.du, -step.beta))
        dual = ((self.sp, -step.y), (self.sn, step.y), (self.zl, step.zl), (self.zu, step.zu))
        fastest = [max(float(np.max(-change / value)) for value, change in side) for side in (primal, dual)]
        return 1.0 / max(fastest[0], 1.0), 1.0 / max(fastest[1], 1.0)

    def _move(self, step: _Direction, primal: float, dual: float) -> None:
        self.beta += primal * step.beta
        self.dl += primal * step.beta
        self.du -= primal * step.beta
        self.p += primal * step.p
        self.n += primal * step.n
        self.sp -= dual * step.y
        self.sn += dual * step.y
        self.zl += dual * step.zl
        self.zu += dual * step.zu

    def _times(self, beta: Array) -> Array:
        return (beta / self._norms) @ self._columns

    def _transposed(self, y: Array) -> Array:
        return (self._columns @ y) / self._norms

    def _slope(self) -> Array:
        """Return W'y + pull."""
        return self._transposed(0.5 * (self.sn - self.sp)) + self._pull

    def _gram(self, d: Array) -> Array:
        """Return W' diag(d) W of the scaled columns, shape (b, b)."""
        root = np.sqrt(d)
        total = np.zeros((len(self._columns),) * 2)
        for start in range(0, len(d), _PANEL):
            panel = self._columns[:, start : start + _PANEL] * root[start : start + _PANEL]
            total += panel @ panel.T
        return total / self._norms / self._norms[:, None]

    def _least_squares(self, target: Array) -> Array:
        return np.linalg.lstsq(self._gram(np.ones(len(target))), self._transposed(target))[0]


def _solver(matrix: Array) -> Callable[[Array], Array]:
    """Return x -> matrix^-1 x for a positive matrix, scaled to a unit diagonal, by its eigenvalues above rounding."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    values, vectors = np.linalg.eigh(matrix * scale * scale[:, None])
    root = (vectors * scale[:, None]) / np.sqrt(np.maximum(values, 1e-15 * values[-1]))
    return lambda right: root @ (right @ root)


@dataclass(frozen=True)
class _Direction:
    """Changes of beta, y, p, n, zl and zu."""

    beta: Array
    y: Array
    p: Array
    n: Array
    zl: Array
    zu: Array
