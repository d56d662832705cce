"""`python -m measured_materials`: the command line."""

from .addon.cli.main import main

raise SystemExit(main())
