function y1 = implicit_solve (problem, y, delta, gradient)
  % IMPLICIT_SOLVE  Y1 = Y + DELTA * B((Y + Y1)/2) * GRADIENT (Y, Y1) for M states Y (d-by-M) and steps DELTA (1-by-M).
  %
  %   The fixed-point iteration of each column goes on until its correction no longer shrinks: a solver that stops at a
  %   tolerance makes invariants drift.  A column that does not converge within 500 iterations is NaN.
  y1 = y;  before = Inf (1, size (y, 2));  open = true (1, size (y, 2));
  for sweep = 1:500
    s = problem.structure ((y(:, open) + y1(:, open)) / 2);
    g = gradient (y(:, open), y1(:, open));
    f = zeros (size (g));
    for k = 1:size (s, 1)
      f(s{k, 1}, :) = f(s{k, 1}, :) + s{k, 3} .* g(s{k, 2}, :);
      f(s{k, 2}, :) = f(s{k, 2}, :) - s{k, 3} .* g(s{k, 1}, :);
    end
    next = y(:, open) + delta(open) .* f;
    change = max (abs (next - y1(:, open)), [], 1);
    scale = max (abs (next), [], 1);
    y1(:, open) = next;
    where = find (open);
    lost = ~ (change < Inf);
    done = ~ lost & (change == 0 | (change <= 1e-13 * scale & change >= before(where)));
    y1(:, where(lost)) = NaN;
    before(where) = change;
    open(where(done | lost)) = false;
    if (~ any (open)), return; end
  end
  y1(:, open) = NaN;
end
