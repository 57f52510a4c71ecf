function sepv_serve (name, method, claims, max_steps, source)
  % SEPV_SERVE  The conversation of docs/protocol.md (protocol 1) on stdin and stdout, for GNU Octave 7 or newer.
  %
  %   sepv_serve (NAME, METHOD, CLAIMS, MAX_STEPS, SOURCE) answers until the message "stop" or the end of stdin.
  %   Y1 = METHOD (PROBLEM, Y, DELTA) gets M states Y (d-by-M) and M random steps DELTA (1-by-M), and returns the
  %   states Y1 (d-by-M); a column of a step that was not solved must be NaN.  PROBLEM has the functions
  %
  %     structure (Y)        the entries of B above the diagonal: a cell array with rows {i, j, B_ij (1-by-M)}
  %     gradient (Y)         the gradient of H, d-by-M
  %     average (Y0, Y1)     the average of the gradient on the segment from Y0 to Y1, d-by-M
  %
  %   Octave's printf has no %a, and sscanf and str2double read a hex float as 0 or NaN without an error: num2hex
  %   and hex2num write and read the bits of a double.

  if (nargin < 5), source = ''; end
  cached = '';  problem = [];
  while (true)
    % fgetl and fgets wait for the first byte AFTER the newline, so they would wait forever here.
    try, line = input ('', 's'); catch, return; end
    message = jsondecode (line, 'makeValidName', false);
    switch (message.type)
      case 'stop'
        return;
      case 'hello'
        answer = sprintf (['{"id":%d,"protocol":1,"scheme":%s,"claims":%s,"mean_square_order":1,' ...
                           '"problems":["harmonic-oscillator","pendulum","rigid-body"],' ...
                           '"polynomial":true,"max_steps":%d,"source":%s}'], message.id, ...
                          jsonencode (name), jsonencode (claims), max_steps, jsonencode (source));
      case 'step'
        % The text of the problem is the same in many messages; parse it once.
        text = problem_text (line);
        try
          if (~ strcmp (text, cached))
            problem = read_problem (message.problem);  cached = text;
          end
          if (isempty (problem))
            answer = sprintf ('{"id":%d,"skip":"unknown problem"}', message.id);
          else
            answer = steps (message, problem, method);
          end
        catch e
          answer = sprintf ('{"id":%d,"error":%s}', message.id, jsonencode (e.message));
        end
      otherwise
        answer = sprintf ('{"id":%d,"error":"unknown type of message"}', message.id);
    end
    fprintf (stdout, '%s\n', answer);
    fflush (stdout);
  end
end

function answer = steps (message, problem, method)
  M = numel (message.steps);
  texts = cell (problem.d + 1 + numel (problem.noise), M);
  for k = 1:M
    s = message.steps(k);
    texts(:, k) = [cells(s.y); {s.h}; cells(s.dW)];
  end
  texts = texts(:);
  m = numel (problem.noise);
  numbers = reshape (from_hex (texts), problem.d + 1 + m, M);
  y = numbers(1:problem.d, :);
  delta = numbers(problem.d + 1, :);
  for j = 1:m   % in order, so that every column has the same bits for every M
    delta = delta + problem.noise(j) * numbers(problem.d + 1 + j, :);
  end
  y1 = method (problem, y, delta);
  if (any (~ isfinite (y1(:))))
    answer = sprintf ('{"id":%d,"error":"no convergence"}', message.id);
    return;
  end
  parts = to_hex (y1(:));
  number = '"%s0x%d.%sp%d",';  row = ['[' repmat(number, 1, problem.d)];
  text = sprintf ([row(1:end - 1) '],'], parts{:});
  answer = sprintf ('{"id":%d,"y_next":[%s]}', message.id, text(1:end - 1));
end

function text = problem_text (line)
  from = strfind (line, '"problem":');  to = strfind (line, '"steps":');
  text = line(from(1):to(end));
end

function c = cells (value)
  if (isempty (value)), c = {}; else, c = value(:); end
end

function problem = read_problem (given)
  if (isfield (given, 'name'))
    p = given.parameters;  problem = [];
    if (~ any (strcmp (given.name, {'harmonic-oscillator', 'pendulum', 'rigid-body'}))), return; end
    problem.noise = from_hex (cells (p.noise));
    switch (given.name)
      case 'harmonic-oscillator'
        problem.d = 2;  problem.structure = @(y) canonical (y);
        problem = with_polynomial (problem, [2 0; 0 2], [0.5; 0.5]);
      case 'pendulum'
        problem.d = 2;  problem.structure = @(y) canonical (y);
        problem.gradient = @(y) [y(1, :); sin(y(2, :))];
        problem.average = @pendulum_average;
      case 'rigid-body'
        problem.d = 3;  inertia = from_hex (cells (p.inertia));
        problem.structure = @(y) {1, 2, -y(3, :); 1, 3, y(2, :); 2, 3, -y(1, :)};
        problem = with_polynomial (problem, 2 * eye (3), 0.5 ./ inertia(:));
    end
  else
    problem.d = given.dimension;
    problem.noise = from_hex (cells (given.noise));
    [E, c] = read_terms (given.hamiltonian, problem.d);
    problem = with_polynomial (problem, E, c);
    n = numel (given.structure);  entries = cell (n, 4);
    for k = 1:n
      entry = element (given.structure, k);
      [E, c] = read_terms (entry{3}, problem.d);
      entries(k, :) = {entry{1} + 1, entry{2} + 1, E, c};
    end
    problem.structure = @(y) polynomial_structure (entries, y);
  end
end

function e = element (list, k)
  if (iscell (list)), e = list{k}; else, e = num2cell (list(k, :)); end
end

function [E, c] = read_terms (terms, d)
  n = numel (terms);  E = zeros (n, d);  c = zeros (n, 1);
  for k = 1:n
    E(k, :) = terms{k}{1}(:).';
    c(k) = from_hex (terms{k}(2));
  end
end

function problem = with_polynomial (problem, E, c)
  d = problem.d;  parts = cell (d, 2);
  for i = 1:d
    keep = E(:, i) > 0;  F = E(keep, :);  parts{i, 2} = c(keep) .* F(:, i);
    F(:, i) = F(:, i) - 1;  parts{i, 1} = F;
  end
  degree = max ([sum(E, 2); 1]) - 1;
  [nodes, weights] = gauss (max (1, ceil ((degree + 1) / 2)));
  problem.gradient = @(y) polynomial_gradient (parts, y);
  problem.average = @(y0, y1) quadrature (problem.gradient, nodes, weights, y0, y1);
end

function g = polynomial_gradient (parts, y)
  g = zeros (size (y));
  for i = 1:size (y, 1), g(i, :) = evaluate (parts{i, 1}, parts{i, 2}, y); end
end

function s = polynomial_structure (entries, y)
  s = cell (size (entries, 1), 3);
  for k = 1:size (entries, 1)
    s(k, :) = {entries{k, 1}, entries{k, 2}, evaluate(entries{k, 3}, entries{k, 4}, y)};
  end
end

function v = evaluate (E, c, y)
  v = zeros (1, size (y, 2));
  for k = 1:numel (c)
    t = c(k) * ones (1, size (y, 2));
    for i = find (E(k, :))
      for r = 1:E(k, i), t = t .* y(i, :); end
    end
    v = v + t;
  end
end

function a = quadrature (gradient, nodes, weights, y0, y1)
  a = zeros (size (y0));
  for k = 1:numel (nodes)
    a = a + weights(k) * gradient (y0 + nodes(k) * (y1 - y0));
  end
end

function [x, w] = gauss (n)
  % Gauss and Legendre's nodes and weights on [0, 1], by Newton's method on P_n.
  x = cos (pi * ((1:n) - 0.25) / (n + 0.5));
  for sweep = 1:10
    p0 = ones (1, n);  p1 = x;
    for k = 2:n, p2 = ((2 * k - 1) * x .* p1 - (k - 1) * p0) / k;  p0 = p1;  p1 = p2; end
    slope = n * (x .* p1 - p0) ./ (x .^ 2 - 1);
    x = x - p1 ./ slope;
  end
  w = 1 ./ ((1 - x .^ 2) .* slope .^ 2);  x = (1 + x) / 2;
  if (n == 1), x = 0.5;  w = 1; end
end

function s = canonical (y)
  s = {1, 2, -ones(1, size (y, 2))};
end

function a = pendulum_average (y0, y1)
  % The mean of sin over [q0, q1] is sin of the middle times sin(x)/x, x half the difference.
  x = (y1(2, :) - y0(2, :)) / 2;
  sinc = ones (size (x));  far = abs (x) > 1e-8;
  sinc(far) = sin (x(far)) ./ x(far);
  a = [(y0(1, :) + y1(1, :)) / 2; sin((y0(2, :) + y1(2, :)) / 2) .* sinc];
end

function x = from_hex (texts)
  % Doubles of sepv's hex floats, '-0x1.<up to 13 digits>p<exponent>': the digits are those of binary64.
  x = zeros (numel (texts), 1);
  if (isempty (texts)), return; end
  C = char (texts);  C(:, end + 1) = ' ';
  minus = C(:, 1) == '-';
  C(minus, :) = [C(minus, 2:end), repmat(' ', sum (minus), 1)];
  [found, at] = max (C == 'p', [], 2);
  if (~ all (found & any (C(:, 3) == '01', 2))), error ('not a hex float of sepv'); end
  for p = unique (at).'   % few different lengths
    g = find (at == p);
    digits = [C(g, 5:p - 1), repmat('0', numel (g), 13 - max (0, p - 5))];
    e = sscanf (C(g, p + 1:end).', '%d');
    e(C(g, 3) == '0') = -1023;   % zero or subnormal
    x(g) = hex2num ([dec2hex(e + 1023 + 2048 * minus(g), 3), digits]);
  end
end

function parts = to_hex (x)
  % The sign, first digit, other digits and exponent of C's %a of finite doubles, in 4 rows of cells.
  bits = num2hex (x);  head = hex2dec (bits(:, 1:3));
  minus = head >= 2048;  head = head - 2048 * minus;  tiny = head == 0;
  sign = {'', '-'};
  parts = [sign(1 + minus); num2cell([~ tiny, head - 1023 + tiny].')];
  parts = [parts(1:2, :); cellstr(bits(:, 4:16)).'; parts(3, :)];
end
