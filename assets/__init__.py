"""The models of the scene, as the scripts that make them. Nothing here is needed to run PaveTwin."""
