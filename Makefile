PYTEST = .venv/bin/python -m pytest -rs -n auto --maxprocesses 8 --dist worksteal
PROPERTIES = $(shell grep -l '^from hypothesis import' test/test_*.py)

.PHONY: demo cockpit test test-all test-browser properties mutants bench clean

demo: ## learn to swing up a pendulum, on a real ROS 2 graph
	@scripts/venv.sh run
	@.venv/bin/iolspi demo

cockpit: ## fly the pendulum yourself, in the browser
	@scripts/venv.sh cockpit
	@.venv/bin/iolspi cockpit

test: ## lint, types, and all tests that are quick
	@scripts/venv.sh test
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	$(PYTEST) -m 'not slow'

test-all: ## the slow tests
	@scripts/venv.sh test
	$(PYTEST) -m 'slow and not browser' --timeout 900

test-browser: ## the cockpit's page in Debian's Chromium
	@scripts/venv.sh test
	.venv/bin/python -m pytest -rs --durations 0 --durations-min 1 -m browser --timeout 900

properties: ## many more examples of each property
	@scripts/venv.sh test
	HYPOTHESIS_PROFILE=thorough $(PYTEST) -m 'not slow' --timeout 900 $(PROPERTIES)

mutants: ## change single lines and see which tests notice; docs/quality.md keeps what it prints
	@scripts/venv.sh test
	.venv/bin/python scripts/mutants.py

bench: ## measure; docs/benchmarks.md keeps what it prints
	@scripts/venv.sh run
	@.venv/bin/python benchmarks/lockstep.py

clean: ## remove what the other targets made
	rm -rf .venv build install log out .*_cache *.egg-info
