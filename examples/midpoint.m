% The implicit midpoint rule with the random step, in GNU Octave:
%
%     sepv verify --exec "octave-cli -qf examples/midpoint.m"
%
% y1 = y + D f((y + y1)/2), f = B grad H, D = h + sum_j c_j dW_j.  octave/sepv_serve.m is the conversation.
addpath (fullfile (fileparts (mfilename ('fullpath')), 'octave'));
average = @(problem) @(y0, y1) problem.gradient ((y0 + y1) / 2);
method = @(problem, y, delta) implicit_solve (problem, y, delta, average (problem));
sepv_serve ('midpoint-octave', method, {'contract', 'identity', 'casimir', 'midpoint', 'symmetry'}, 1024, ...
            'Milstein, Repin and Tretyakov (2002), equation (3.4)');
