% The scheme of Cohen and Dujardin (2014), equation (2.1), in GNU Octave:
%
%     sepv verify --exec "octave-cli -qf examples/energy_preserving.m"
%
% y1 = y + D B((y + y1)/2) times the average of grad H on the segment from y to y1.
addpath (fullfile (fileparts (mfilename ('fullpath')), 'octave'));
method = @(problem, y, delta) implicit_solve (problem, y, delta, problem.average);
sepv_serve ('energy-preserving-octave', method, {'contract', 'identity', 'energy', 'casimir', 'symmetry'}, 1024, ...
            'Cohen and Dujardin (2014), equation (2.1)');
