.PHONY: demo test bench clean

demo: ## learn to swing up a pendulum from demonstrations, on a real ROS 2 graph
	@scripts/venv.sh run
	@.venv/bin/iolspi demo

test: ## lint, types and tests
	@scripts/venv.sh test
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/python -m pytest

bench: ## measure; docs/benchmarks.md keeps what it prints
	@scripts/venv.sh run
	@.venv/bin/python benchmarks/lockstep.py

clean: ## remove what the other targets made
	rm -rf .venv build install log out .*_cache *.egg-info
